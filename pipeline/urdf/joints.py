"""The joints that move a robot: each has a motor, limits with a range between them, and moves by itself."""

from collections import Counter
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from pipeline.arrays import Floats
from pipeline.urdf.description import end_link, named
from recorders.errors import RobotError
from recorders.text.wording import names_text, value_text

MIN_RANGE = 1e-6  # [rad or m], between the limits of a joint: what moves less does not move
MAX_POSITION = 25.0  # [rad or m], of a limit: four turns; beyond it are no limits, or another unit


def moved_links(urdf: Element) -> set[str]:
    """Return the links that hang on a joint that moves."""
    joints = [joint for joint in urdf.iterfind("joint") if joint.get("type") != "fixed"]
    return {child.get("link", "") for joint in joints for child in joint.iterfind("child")}


def chain_to(urdf: Element, link: str) -> list[str]:
    """Return the joints that move between the root of a checked URDF and a link, from the root on."""
    above = {end_link(joint, "child"): joint for joint in urdf.iterfind("joint")}
    moving = []
    while (joint := above.get(link)) is not None:
        if joint.get("type") != "fixed":
            moving.append(joint.get("name", ""))
        link = end_link(joint, "parent")
    return moving[::-1]


def moving_joints(urdf: Element, link: str) -> set[str]:
    """Return the joints that move between the root of a checked URDF and a link."""
    return set(chain_to(urdf, link))


def joint_limits(urdf: Element, joints: Sequence[str]) -> tuple[Floats, Floats]:
    """Lower and upper position limits [rad or m] of all movable joints, in the order of `joints`, each (n,).

    Raises
    ------
    RobotError
        `joints` are not the movable joints of the URDF, or one is to mimic another, has no range of positions, no
        transmission or two, or no effort that it may exert.
    """
    movable = {name: joint for name, joint in named(urdf, "joint").items() if joint.get("type") != "fixed"}
    for name, joint in movable.items():
        if (mimic := joint.find("mimic")) is not None:
            leader = value_text(mimic.get("joint", ""))
            raise RobotError(
                f"joint {name} of the URDF is to mimic {leader}: expected one that moves by itself; make it a fixed one"
            )
    if missing := [name for name in joints if name not in movable]:
        raise RobotError(
            f"joints {names_text(missing)} of the robot config are not movable joints of the URDF, "
            f"which has {names_text(sorted(movable)) or 'none'}"
        )
    if unnamed := sorted(movable.keys() - set(joints)):
        raise RobotError(f"movable joints {names_text(unnamed)} of the URDF are not in the robot config")
    _check_motors(urdf, joints)
    limits = [_range(f"joint {name} of the URDF", movable[name]) for name in joints]
    return np.array([lower for lower, _ in limits]), np.array([upper for _, upper in limits])


def speed_limits(urdf: Element, joints: Sequence[str]) -> Floats:
    """Speed limits [rad/s or m/s] of `joints`, shape (n,); infinite where the URDF states 0 or none."""
    limits = {name: joint.find("limit") for name, joint in named(urdf, "joint").items()}
    speeds = [0.0 if (limit := limits[name]) is None else float(limit.get("velocity", "0")) for name in joints]
    return np.array([speed or np.inf for speed in speeds])


def effort_limits(urdf: Element, joints: Sequence[str]) -> Floats:
    """Effort limits [N m or N] of `joints` of a checked URDF, shape (n,)."""
    elements = named(urdf, "joint")
    limits = [elements[name].find("limit") for name in joints]
    return np.array([0.0 if limit is None else float(limit.get("effort", "0")) for limit in limits])


def _check_motors(urdf: Element, joints: Sequence[str]) -> None:
    motors = Counter(element.get("name", "") for element in urdf.iterfind("transmission/joint"))
    if unmoved := [name for name in joints if name not in motors]:
        raise RobotError(
            f"joints {names_text(unmoved)} of the URDF have no transmission of type "
            "transmission_interface/SimpleTransmission, so nothing would move them"
        )
    if several := [name for name in joints if motors[name] > 1]:
        raise RobotError(f"joint {several[0]} of the URDF: expected one transmission, found {motors[several[0]]}")


def _range(where: str, joint: Element) -> tuple[float, float]:
    """Return the limits of a joint that is to move a robot [rad or m]."""
    kind, limit = joint.get("type"), joint.find("limit")
    if kind not in ("revolute", "prismatic"):
        expected = "expected a revolute or prismatic one, which moves between limits"
        raise RobotError(f"{where}: {expected}, found {kind}")
    values = {} if limit is None else {key: float(value) for key, value in limit.attrib.items()}
    for key in ("lower", "upper"):
        if key not in values:
            raise RobotError(f"{where}: expected <limit {key}=...>, found none")
        if abs(values[key]) > MAX_POSITION:
            unit = "rad" if kind == "revolute" else "m"
            expected = f"expected <limit {key}=...> within {MAX_POSITION:g} {unit} of zero"
            raise RobotError(f"{where}: {expected}, found {values[key]:g}")
    if not values["lower"] < values["upper"]:
        found = f"found {values['lower']:g} and {values['upper']:g}"
        raise RobotError(f"{where}: expected <limit lower=...> below <limit upper=...>, {found}")
    if (moves := values["upper"] - values["lower"]) < MIN_RANGE:
        raise RobotError(f"{where}: expected limits at least {MIN_RANGE:g} apart, found {moves:g}; make it a fixed one")
    if not values["effort"] > 0.0:
        raise RobotError(f"{where}: expected <limit effort=...> above 0, found {values['effort']:g}")
    for key, value in (("velocity", values["velocity"]), *_damping(joint)):
        if value < 0.0:
            raise RobotError(f"{where}: expected a {key} of at least 0, found {value:g}")
    return values["lower"], values["upper"]


def _damping(joint: Element) -> list[tuple[str, float]]:
    dynamics = joint.find("dynamics")
    return [] if dynamics is None else [(key, float(value)) for key, value in dynamics.attrib.items()]
