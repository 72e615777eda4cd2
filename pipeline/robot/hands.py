"""The hands of a robot's config: a name, a link, what is controlled of it, and the box in which it is asked to move."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from pipeline.robot.toml_values import Vector, as_list, as_name, as_numbers, as_table, row_text
from recorders.errors import RobotError
from recorders.messages.topics import HAND_NAME
from recorders.text.wording import hand_text, names_text, value_text

MAX_CENTRE_M = 10.0
"""No hand's centre lies farther than this from the world's origin, along each axis [m]: beyond it are other units."""

MAX_HANDS = 16
"""More hands than any robot has: work and topics grow with them."""

MAX_TURN_RAD = 2.0
"""Largest diagonal of the half extents of a turn [rad]: a hand on its way there stays within `REGULAR_RAD`."""

POSITION, POSE = "position", "pose"
CONTROLS = (POSITION, POSE)
"""What may be controlled of a hand: where it is, or also how it is turned."""

Quaternion: TypeAlias = tuple[float, float, float, float]

_UNIT = 1e-3  # a quaternion's length may differ from 1 by this much: it is written with a few digits

_KEYS = frozenset({"name", "link", "controls", "centre", "box"})


@dataclass(frozen=True)
class Hand:
    """A link whose origin is asked to be somewhere, and which may be asked to be turned in some way.

    The turn of a hand is its rotation vector [rad], in the axes of the world, from the orientation that it has in the
    middle.

    Attributes
    ----------
    name : str
        Part of its topics, of the columns of motions and of the names of results.
    link : str
        Link of the URDF whose origin is the hand's position.
    controls : str
        What is asked of it: "position" or "pose".
    centre : (float, float, float)
        Middle of what it draws [m], world frame.
    box : (float, float, float)
        Half extents, along the axes of the world, of the box about `centre` in which targets are explored [m].
    orientation : (float, float, float, float) or None
        Orientation in the middle, as a unit quaternion x, y, z, w; None where only the position is controlled.
    turn : (float, float, float) or None
        Half extents of the turns that are explored [rad]; None where only the position is controlled.
    """

    name: str
    link: str
    controls: str
    centre: Vector
    box: Vector
    orientation: Quaternion | None = None
    turn: Vector | None = None


def parse_hands(value: object) -> tuple[Hand, ...]:
    """Return the hands of the `[[hands]]` of a robot's config.

    Raises
    ------
    RobotError
        There is none, or too many; a key is missing, unknown or of the wrong kind; or two hands have one name.
    """
    rows = as_list(value, "[[hands]]")
    if not 1 <= len(rows) <= MAX_HANDS:
        raise RobotError(f"[[hands]] of the robot config: expected 1 to {MAX_HANDS} hands, found {len(rows)}")
    hands = tuple(_hand(as_table(row, _KEYS, row_text(row, "hand", index)), index) for index, row in enumerate(rows))
    if repeated := [name for name, count in Counter(hand.name for hand in hands).items() if count > 1]:
        raise RobotError(f"hands of the robot config: {names_text(repeated)} given more than once")
    return hands


def _hand(table: Mapping[str, object], index: int) -> Hand:
    name = as_name(table["name"], f"name of hand number {index + 1}")
    if not HAND_NAME.fullmatch(name):
        expected = "expected small letters, digits and '_', a letter first"
        raise RobotError(f"name of hand number {index + 1} of the robot config: {expected}, found {value_text(name)}")
    controls = table["controls"]
    if controls not in CONTROLS:
        expected = " or ".join(f'"{known}"' for known in CONTROLS)
        raise RobotError(
            f"controls of {hand_text(name)} of the robot config: expected {expected}, found {value_text(controls)}"
        )
    is_pose = controls == POSE
    centre = as_numbers(table["centre"], f"centre of {hand_text(name)}", 7 if is_pose else 3)
    box = as_numbers(table["box"], f"box of {hand_text(name)}", 6 if is_pose else 3)
    if (farthest := max(map(abs, centre[:3]))) > MAX_CENTRE_M:
        expected = f"expected numbers within {MAX_CENTRE_M:g} m of zero"
        raise RobotError(f"centre of {hand_text(name)} of the robot config: {expected}, found {farthest:g}")
    if not all(0.0 < extent <= MAX_CENTRE_M for extent in box[:3]):
        expected = f"expected half extents above 0 and at most {MAX_CENTRE_M:g} m"
        raise RobotError(f"box of {hand_text(name)} of the robot config: {expected}, found {value_text(list(box))}")
    link = as_name(table["link"], f"link of {hand_text(name)}")
    if not is_pose:
        return Hand(name, link, POSITION, _vector(centre), _vector(box))
    orientation, turn = _orientation(name, centre[3:]), _turn(name, box[3:])
    return Hand(name, link, POSE, _vector(centre[:3]), _vector(box[:3]), orientation, turn)


def _vector(numbers: tuple[float, ...]) -> Vector:
    x, y, z = numbers
    return x, y, z


def _orientation(hand: str, numbers: tuple[float, ...]) -> Quaternion:
    """Return four numbers as a quaternion of length 1."""
    length = math.sqrt(sum(number * number for number in numbers))
    if not abs(length - 1.0) <= _UNIT:
        raise RobotError(
            f"centre of {hand_text(hand)} of the robot config: expected x, y, z and a unit quaternion x, y, z, w, "
            f"found one of length {length:g}"
        )
    x, y, z, w = (number / length for number in numbers)
    return x, y, z, w


def _turn(hand: str, numbers: tuple[float, ...]) -> Vector:
    diagonal = math.sqrt(sum(number * number for number in numbers))
    if not (min(numbers) > 0.0 and diagonal <= MAX_TURN_RAD):
        raise RobotError(
            f"box of {hand_text(hand)} of the robot config: expected half extents of turns above 0, with a diagonal of "
            f"at most {MAX_TURN_RAD:g} rad, found {value_text(list(numbers))}"
        )
    return _vector(numbers)
