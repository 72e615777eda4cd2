"""The hands of a robot's config: a name, a link, what is controlled of it, and the box in which it is asked to move."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.robot.toml_values import Vector, as_list, as_name, as_point, as_table
from recorders.errors import RobotError
from recorders.messages.topics import HAND_NAME
from recorders.text.wording import names_text, value_text

MAX_CENTRE_M = 10.0
"""No hand's centre lies farther than this from the world's origin, along each axis [m]: beyond it are other units."""

MAX_HANDS = 16
"""More hands than any robot has: work and topics grow with them."""

POSITION = "position"

_KEYS = frozenset({"name", "link", "controls", "centre", "box"})


@dataclass(frozen=True)
class Hand:
    """A link whose origin is asked to be somewhere.

    Attributes
    ----------
    name : str
        Part of its topics, of the columns of motions and of the names of results.
    link : str
        Link of the URDF whose origin is the hand's position.
    controls : str
        What is asked of it: "position".
    centre : (float, float, float)
        Middle of what it draws [m], world frame.
    box : (float, float, float)
        Half extents, along the axes of the world, of the box about `centre` in which targets are explored [m].
    """

    name: str
    link: str
    controls: str
    centre: Vector
    box: Vector


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
    hands = tuple(_hand(as_table(row, _KEYS, f"hand {index}"), index) for index, row in enumerate(rows))
    if repeated := [name for name, count in Counter(hand.name for hand in hands).items() if count > 1]:
        raise RobotError(f"hands of the robot config: {names_text(repeated)} given more than once")
    return hands


def _hand(table: Mapping[str, object], index: int) -> Hand:
    name = as_name(table["name"], f"name of hand {index}")
    if not HAND_NAME.fullmatch(name):
        expected = "expected small letters, digits and '_', a letter first"
        raise RobotError(f"name of hand {index} of the robot config: {expected}, found {value_text(name)}")
    if table["controls"] != POSITION:
        found = value_text(table["controls"])
        raise RobotError(
            f'controls of hand {name} of the robot config: expected "{POSITION}", found {found}; poses come later'
        )
    centre, box = as_point(table["centre"], f"centre of hand {name}"), as_point(table["box"], f"box of hand {name}")
    if (farthest := max(map(abs, centre))) > MAX_CENTRE_M:
        expected = f"expected numbers within {MAX_CENTRE_M:g} m of zero"
        raise RobotError(f"centre of hand {name} of the robot config: {expected}, found {farthest:g}")
    if not all(0.0 < extent <= MAX_CENTRE_M for extent in box):
        expected = f"expected half extents above 0 and at most {MAX_CENTRE_M:g} m"
        raise RobotError(f"box of hand {name} of the robot config: {expected}, found {value_text(list(box))}")
    return Hand(name, as_name(table["link"], f"link of hand {name}"), POSITION, centre, box)
