"""Joints of a model that move hands, with their limits, and all other movable joints, which become rigid."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from xml.etree.ElementTree import Element

from pipeline.robot.importing.import_spec import JointLimits
from pipeline.urdf.description import named
from pipeline.urdf.joints import MAX_POSITION, MIN_RANGE, chain_to
from recorders.errors import RobotError
from recorders.text.wording import hand_text, names_text

SLIDING = "prismatic"

_ASSUMED = {"revolute": {"velocity": 2.0, "effort": 100.0}, SLIDING: {"velocity": 0.5, "effort": 1000.0}}
_TURNING = ("revolute", "continuous")


@dataclass(frozen=True)
class ModelJoint:
    """Joint of a model that moves a hand.

    Attributes
    ----------
    name : str
    type : str
        "revolute" or "prismatic", once it has limits.
    limits : JointLimits
        Its limits, all four of them.
    given : JointLimits or None
        Those that are not the model's; None if all are.
    assumed : tuple of str
        Which of `effort` and `velocity` are nobody's: neither the model nor an option states them.
    hands : tuple of str
        The hands that it moves.
    """

    name: str
    type: str
    limits: JointLimits
    given: JointLimits | None
    assumed: tuple[str, ...]
    hands: tuple[str, ...]


def model_joints(
    urdf: Element,
    hands: Mapping[str, str],
    *,
    limits: Sequence[tuple[str, JointLimits]] = (),
    rigid: Sequence[str] = (),
    least: int = 3,
) -> tuple[ModelJoint, ...]:
    """Return the joints that move hands, from the ground outwards, hand by hand.

    Parameters
    ----------
    urdf : Element
        The parsed URDF.
    hands : mapping of str to str
        Links of the hands, by name.
    limits : sequence of (str, JointLimits)
        Limits by joint, or by a pattern such as `wrist_*`, in place of the model's; the last that matches counts.
    rigid : sequence of str
        Joints that are to be rigid.
    least : int
        Fewest joints that take a hand wherever it is asked to be.

    Raises
    ------
    RobotError
        A hand is no link or nothing moves it, a joint cannot be one of a robot's, or has no limits; the line names all
        that have none.
    """
    links = named(urdf, "link")
    if missing := [link for link in hands.values() if link not in links]:
        raise RobotError(
            f"--hand: expected links of the URDF, found {names_text(missing)}; it has {names_text(sorted(links))}"
        )
    elements = named(urdf, "joint")
    chains = {hand: [name for name in chain_to(urdf, link) if name not in rigid] for hand, link in hands.items()}
    for hand, chain in chains.items():
        if len(chain) < least:
            expected = f"expected at least {least} joints that move link {hands[hand]}"
            raise RobotError(f"{hand_text(hand)}: {expected}, found {names_text(chain) or 'none'}")
    names = list(dict.fromkeys(name for chain in chains.values() for name in chain))
    _check_patterns(names, [pattern for pattern, _ in limits])
    given = {name: _last_match(name, limits) for name in names}
    _check_types({name: elements[name] for name in names})
    _check_limited({name: elements[name] for name in names if given[name] is None})
    return tuple(
        _joint(elements[name], given[name], tuple(hand for hand, chain in chains.items() if name in chain))
        for name in names
    )


def rigid_positions(
    urdf: Element, joints: Sequence[str], rigid: Mapping[str, float], dropped: Sequence[str] = ()
) -> dict[str, float]:
    """Return where other movable joints are fixed that cannot be at 0, or are asked to be elsewhere [rad or m].

    Those that mimic another follow it; those in `dropped` are not there.
    """
    positions = dict(rigid)
    for name, joint in named(urdf, "joint").items():
        limit = joint.find("limit")
        others = name not in joints and name not in rigid and name not in dropped
        if others and joint.get("type") in ("revolute", SLIDING) and limit is not None and joint.find("mimic") is None:
            lower, upper = (float(limit.get(end, "0")) for end in ("lower", "upper"))
            if not lower <= 0.0 <= upper:
                positions[name] = round((lower + upper) / 2.0, 4)
    return positions


def _check_patterns(names: Sequence[str], patterns: Sequence[str]) -> None:
    if unmatched := [pattern for pattern in patterns if not any(fnmatchcase(name, pattern) for name in names)]:
        raise RobotError(f"limits of '{unmatched[0]}': expected one of the joints {names_text(names)}")


def _last_match(name: str, limits: Sequence[tuple[str, JointLimits]]) -> JointLimits | None:
    return next((given for pattern, given in reversed(limits) if fnmatchcase(name, pattern)), None)


def _check_types(joints: Mapping[str, Element]) -> None:
    for name, joint in joints.items():
        if joint.get("type") not in (*_TURNING, SLIDING):
            found = joint.get("type")
            raise RobotError(
                f"joint {name}: expected one that turns or slides, found {found}; make it rigid: --fix {name}"
            )
        if joint.find("mimic") is not None:
            raise RobotError(
                f"joint {name} mimics another: expected one that moves by itself; make it rigid: --fix {name}"
            )


def _check_limited(joints: Mapping[str, Element]) -> None:
    if unlimited := [name for name, joint in joints.items() if not _has_limits(joint)]:
        one = unlimited[0]
        turning = joints[one].get("type") != SLIDING
        example = f"--limit {one}=-3.14,3.14" if turning else f"--limit {one}=0,0.5"
        raise RobotError(
            f"joints without limits: {names_text(unlimited)}: expected lower and upper ones "
            f"[{'rad' if turning else 'm'}] for each, as with {example}; '*' stands for any letters"
        )


def _has_limits(joint: Element) -> bool:
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return False
    lower, upper = (float(limit.get(end, "nan")) for end in ("lower", "upper"))
    return upper - lower >= MIN_RANGE and max(abs(lower), abs(upper)) <= MAX_POSITION  # False where one is missing


def _joint(element: Element, given: JointLimits | None, hands: tuple[str, ...]) -> ModelJoint:
    name, kind = element.get("name", ""), SLIDING if element.get("type") == SLIDING else "revolute"
    limit = element.find("limit")
    known = {} if limit is None else {key: float(value) for key, value in limit.attrib.items()}
    if given is not None:
        known |= given.given()
        _check_range(name, given)
    assumed = {key: value for key, value in _ASSUMED[kind].items() if not known.get(key, 0.0) > 0.0}
    limits = JointLimits(**{key: (known | assumed)[key] for key in ("lower", "upper", "effort", "velocity")})
    changed = limits if given is not None or assumed else None
    return ModelJoint(name, kind, limits, changed, tuple(sorted(assumed)), hands)


def _check_range(name: str, given: JointLimits) -> None:
    if not (given.upper - given.lower >= MIN_RANGE and max(abs(given.lower), abs(given.upper)) <= MAX_POSITION):
        raise RobotError(
            f"limits of {name}: expected a lower one below an upper one, within {MAX_POSITION:g} of zero, "
            f"found {given.lower:g} and {given.upper:g}"
        )
    if not all(0.0 < value < math.inf for key, value in given.given().items() if key in ("effort", "velocity")):
        raise RobotError(f"limits of {name}: expected effort and velocity above 0")
