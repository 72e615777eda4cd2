"""Texts of a command line that ask for a robot: hands, limits, rigid joints."""

import math
import re
from collections.abc import Sequence

from pipeline.robot.importing.import_spec import JointLimits
from recorders.errors import RobotError
from recorders.messages.topics import HAND_NAME
from recorders.text.wording import names_text

_SIDES = ("left", "right")
_MOTOR = ("velocity", "effort")


def parse_hands(texts: Sequence[str]) -> dict[str, str]:
    """Return the links of hands by name, of texts LINK or NAME=LINK.

    Without a name, an only hand is called `hand`; one of several `left` or `right` where its link's name holds that
    word, and else as its link.

    Raises
    ------
    RobotError
        There is none, a name cannot be a hand's, or two have one name.

    Examples
    --------
    >>> parse_hands(["panda_hand_tcp"])
    {'hand': 'panda_hand_tcp'}
    >>> parse_hands(["left_palm", "tail=Tail_Tip"])
    {'left': 'left_palm', 'tail': 'Tail_Tip'}
    """
    hands: dict[str, str] = {}
    for text in texts:
        before, equals, after = text.partition("=")
        name, link = (before, after) if equals else (_hand_name(text, only=len(texts) == 1), text)
        if not HAND_NAME.fullmatch(name) or not link:
            raise RobotError(f"--hand: expected LINK, or NAME=LINK with a name of small letters, found {text!r:.80}")
        if name in hands:
            raise RobotError(
                f"--hand: two hands are called {name}, {hands[name]} and {link}: expected names for them, as NAME=LINK"
            )
        hands[name] = link
    if not hands:
        raise RobotError("--hand: expected the link of at least one hand")
    return hands


def parse_limits(texts: Sequence[str]) -> tuple[tuple[str, JointLimits], ...]:
    """Return limits by joint or pattern, of texts JOINT=LOWER,UPPER[,VELOCITY[,EFFORT]]; raises RobotError.

    Examples
    --------
    >>> parse_limits(["wrist_*=-3,3,1.5"])
    (('wrist_*', JointLimits(lower=-3.0, upper=3.0, effort=None, velocity=1.5)),)
    """
    return tuple(_limits(text) for text in texts)


def parse_rigid(texts: Sequence[str]) -> dict[str, float]:
    """Return where joints are rigid [rad or m], of texts JOINT or JOINT=POSITION; raises RobotError.

    Examples
    --------
    >>> parse_rigid(["elbow=1.2", "wrist"])
    {'elbow': 1.2, 'wrist': 0.0}
    """
    positions = {}
    for text in texts:
        joint, equals, number = text.partition("=")
        position = _number(number) if equals else 0.0
        if not joint or position is None:
            raise RobotError(f"--fix: expected JOINT or JOINT=POSITION, found {text!r:.80}")
        positions[joint] = position
    return positions


def robot_name(text: str) -> str:
    """Return a name for a robot, made of that of its folder.

    Examples
    --------
    >>> robot_name("My Arm.v2")
    'my_arm_v2'
    """
    return re.sub(r"[^a-z0-9_-]+", "_", text.lower()).strip("_") or "robot"


def _hand_name(link: str, *, only: bool) -> str:
    if only:
        return "hand"
    sides = [side for side in _SIDES if side in link.lower()]
    if len(sides) == 1:
        return sides[0]
    return re.sub(r"[^a-z0-9]+", "_", link.lower()).strip("_")


def _limits(text: str) -> tuple[str, JointLimits]:
    joint, _, after = text.rpartition("=")
    numbers = [_number(part) for part in after.split(",")]
    found = [number for number in numbers if number is not None]
    if not joint or len(found) != len(numbers) or not 2 <= len(found) <= 2 + len(_MOTOR):
        expected = f"JOINT=LOWER,UPPER, and {names_text(_MOTOR)} behind them where the URDF lacks these"
        raise RobotError(f"--limit: expected {expected}, found {text!r:.80}")
    return joint, JointLimits(found[0], found[1], **dict(zip(_MOTOR, found[2:], strict=False)))


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
