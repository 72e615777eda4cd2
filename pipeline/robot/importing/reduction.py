"""A model of others loses the joints that are not wanted: they are fixed, and what is then one body has one mass."""

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio

from pipeline.robot.pinocchio_model import build_model, joint_index
from pipeline.urdf.description import named
from recorders.errors import RobotError
from recorders.text.wording import value_text

_NEAR = 1e-9  # two positions that are to be the same [rad or m]


def reduced_model(whole: Element, *, joints: Sequence[str], frozen: Mapping[str, float]) -> Any:
    """Return the `pinocchio.Model` of a URDF with no other joints than `joints`.

    Parameters
    ----------
    whole : Element
        The parsed URDF.
    joints : sequence of str
        The movable joints that stay.
    frozen : mapping of str to float
        Where others are fixed [rad or m]; at 0 if they are not named, and a joint that mimics another where that puts
        it.

    Raises
    ------
    RobotError
        The URDF does not build, a position is beyond a joint's limits, or a joint mimics another that moves.
    """
    positions = _positions(whole, joints, frozen)
    try:
        model = build_model(whole)
    except RobotError as error:
        raise RobotError(f"the robot's model: {error}") from error
    posture = pinocchio.neutral(model)
    for name, position in positions.items():
        _freeze(model, posture, name, position)
    return pinocchio.buildReducedModel(model, sorted(joint_index(model, name) for name in positions), posture)


def _positions(whole: Element, joints: Sequence[str], frozen: Mapping[str, float]) -> dict[str, float]:
    """Return where each joint that does not stay is fixed [rad or m]."""
    movable = {name: joint for name, joint in named(whole, "joint").items() if joint.get("type") != "fixed"}
    mimics = {name: mimic for name, joint in movable.items() if (mimic := joint.find("mimic")) is not None}
    if headless := [name for name, mimic in mimics.items() if not mimic.get("joint")]:
        raise RobotError(f"joint {headless[0]} of the model: expected <mimic joint=...>, found none")
    positions = {name: frozen.get(name, 0.0) for name in movable if name not in joints and name not in mimics}
    if both := [name for name in joints if name in mimics]:
        raise RobotError(
            f"joint {both[0]} of the model is to mimic {value_text(mimics[both[0]].get('joint'))}: expected the "
            "robot's joints to move by themselves; leave it out of them, or drop it"
        )
    waiting = list(mimics)
    while waiting:
        ready = [name for name in waiting if mimics[name].get("joint") in positions]
        if not ready:
            raise RobotError(_unmimicked(waiting[0], mimics[waiting[0]].get("joint", ""), joints, waiting))
        for name in ready:
            positions[name] = _mimicked(name, mimics[name], positions, frozen)
        waiting = [name for name in waiting if name not in positions]
    return positions


def _mimicked(name: str, mimic: Element, positions: Mapping[str, float], frozen: Mapping[str, float]) -> float:
    leader = mimic.get("joint", "")
    position = float(mimic.get("multiplier", "1")) * positions[leader] + float(mimic.get("offset", "0"))
    if abs(frozen.get(name, position) - position) > _NEAR:
        raise RobotError(
            f"[frozen] {name}: expected {position:g}, as it is to mimic {leader} at {positions[leader]:g}, "
            f"found {frozen[name]:g}"
        )
    return position


def _unmimicked(name: str, leader: str, joints: Sequence[str], waiting: Sequence[str]) -> str:
    where = f"joint {name} of the model is to mimic"
    if leader in joints:
        return f"{where} {leader}, which is among the robot's joints: expected one that is frozen; drop {name}"
    if leader in waiting:
        return f"{where} {leader}, which waits for another in a ring: expected one that moves by itself"
    return f"{where} {value_text(leader)}: expected a movable joint of the model that is not dropped; drop {name} too"


def _freeze(model: Any, posture: Any, name: str, value: float) -> None:
    joint = model.joints[joint_index(model, name)]
    if joint.nv != 1:
        if value:
            raise RobotError(
                f"[frozen] {name}: expected 0 for a joint of {joint.nv} degrees of freedom, found {value:g}"
            )
    elif joint.nq == 2:  # without limits: Pinocchio keeps cosine and sine
        posture[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    else:
        low, high = (limit[joint.idx_q] for limit in (model.lowerPositionLimit, model.upperPositionLimit))
        if not low <= value <= high:
            raise RobotError(f"[frozen] {name}: expected between its limits {low:g} and {high:g}, found {value:g}")
        posture[joint.idx_q] = value
