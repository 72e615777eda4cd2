"""Columns of a LeRobotDataset that hold joints, hands and actions, and the topic and message that each becomes."""

from collections.abc import Callable, Collection
from typing import NamedTuple

from recorders.errors import LogError
from recorders.messages.message_types import Float64MultiArray, JointState, Message, PoseStamped
from recorders.messages.topics import (
    HAND_NAME,
    JOINT_COMMANDS,
    JOINT_STATES,
    hand_measured,
    hand_target,
)
from recorders.messages.validation import FloatArray
from recorders.reading.lerobot_info import Feature, LeRobotInfo
from recorders.text.wording import names_text, value_text

STATE, ACTION = "observation.state", "action"
HANDS, TARGETS = "observation.hand.", "observation.target."
"""What the columns of hands begin with, as measured and as asked for; their names follow."""

ACTION_TOPIC = "/action"
"""The topic of actions that are neither of joints nor of hands."""

AXES = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Names of the numbers of a hand: position [m], and quaternion where it is there."""

COUNTERS = frozenset({"timestamp", "frame_index", "episode_index", "index", "task_index"})
"""Columns that every dataset has."""

_POSITION, _POSE = 3, 7
_JOINT_SUFFIX = ".pos"  # LeRobot's own arms name `shoulder_pan.pos` what their URDF names `shoulder_pan`


class Column(NamedTuple):
    """Numbers of a frame that become one message.

    Attributes
    ----------
    feature : str
        The column.
    places : slice
        Which of its numbers.
    topic, type : str
        Topic and type of the message.
    message : callable
        Makes it of the stamp [ns] and the numbers.
    """

    feature: str
    places: slice
    topic: str
    type: str
    message: Callable[[int, FloatArray], Message]


def columns_of(info: LeRobotInfo, *, where: str) -> list[Column]:
    """Return the columns that become messages, hands first.

    Parameters
    ----------
    info : LeRobotInfo
        The dataset.
    where : str
        Its name, for an error line.

    Raises
    ------
    LogError
        If there are no joints, or they have no names.
    """
    state = info.features.get(STATE)
    if state is None or not state.is_row:
        others = names_text(sorted(set(info.features) - COUNTERS), limit=200)
        raise LogError(f"{where}: expected joints in {STATE}, found {others or 'no feature'}")
    joints = tuple(name.removesuffix(_JOINT_SUFFIX) for name in state.names)
    if not joints or len(set(joints)) != len(joints):
        raise LogError(
            f"{where}: {STATE}: expected a name for each of its {state.size} joints, found "
            f"{names_text(map(value_text, state.names), limit=200) or 'none'}; write them into meta/info.json as names"
        )
    found = [
        _hand(name, slice(None), topic(hand), feature.size)
        for name, feature in info.features.items()
        for start, topic in ((HANDS, hand_measured), (TARGETS, hand_target))
        if name.startswith(start) and _is_hand(hand := name.removeprefix(start), feature)
    ]
    if (action := info.features.get(ACTION)) is not None and action.is_row:
        found += _of_action(action, joints)
    return [*found, _joints(STATE, joints, JOINT_STATES)]


def left_out(info: LeRobotInfo, columns: Collection[Column]) -> list[str]:
    """Return the columns that become no messages, with their types."""
    used = {column.feature for column in columns} | COUNTERS
    return [f"{name} ({feature.dtype})" for name, feature in info.features.items() if name not in used]


def _is_hand(name: str, feature: Feature) -> bool:
    return bool(HAND_NAME.fullmatch(name)) and feature.is_row and feature.size in (_POSITION, _POSE)


def _of_action(action: Feature, joints: tuple[str, ...]) -> list[Column]:
    """Return actions as commands where they are of joints, as targets where they are of hands, or as they are."""
    names = tuple(name.removesuffix(_JOINT_SUFFIX) for name in action.names)
    if names and len(set(names)) == len(names) and set(names) <= set(joints):
        return [_joints(ACTION, names, JOINT_COMMANDS)]
    if hands := _hands_in(action.names):
        return [_hand(ACTION, places, hand_target(hand), places.stop - places.start) for hand, places in hands]
    return [
        Column(
            ACTION, slice(None), ACTION_TOPIC, Float64MultiArray.TYPE, lambda stamp, values: Float64MultiArray(values)
        )
    ]


def _hands_in(names: tuple[str, ...]) -> list[tuple[str, slice]]:
    """Return hands and the places of their numbers, if all names are those of hands; else none."""
    found: list[tuple[str, slice]] = []
    start = 0
    while start < len(names):
        hand = names[start].rpartition(".")[0]
        size = next((n for n in (_POSE, _POSITION) if names[start : start + n] == axis_names(hand, n)), 0)
        if not size or not HAND_NAME.fullmatch(hand) or hand in dict(found):
            return []
        found.append((hand, slice(start, start + size)))
        start += size
    return found


def axis_names(hand: str, size: int) -> tuple[str, ...]:
    """Return the names of the numbers of a hand, such as `right.x`."""
    return tuple(f"{hand}.{axis}" for axis in AXES[:size])


def _joints(feature: str, names: tuple[str, ...], topic: str) -> Column:
    return Column(feature, slice(None), topic, JointState.TYPE, lambda stamp, values: JointState(stamp, names, values))


def _hand(feature: str, places: slice, topic: str, size: int) -> Column:
    def message(stamp_ns: int, values: FloatArray) -> Message:
        if size == _POSITION:
            return PoseStamped(stamp_ns, values)
        return PoseStamped(stamp_ns, values[:_POSITION], orientation=values[_POSITION:])

    return Column(feature, places, topic, PoseStamped.TYPE, message)
