"""Ticks for training: the messages of one sample in recorded order, where anything amiss is an error."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from math import isfinite
from operator import itemgetter
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, JointError, MessageError, OutOfRange
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, is_measured, type_of
from recorders.messages.validation import FloatArray, read_only
from recorders.text.wording import names_text
from recorders.ticks.stamp_joiner import OpenTick, StampJoiner, name_of

MAX_OPEN = 4096  # ticks; a publisher that stays silent must not fill the memory

Check: TypeAlias = Callable[[FloatArray | JointState], None]
"""Raises JointError or MessageError for a position [m] (3,), or pose (6,), or joints that cannot be the robot's."""

PoseReader: TypeAlias = Callable[[PoseStamped], FloatArray]
"""Returns the numbers of a hand whose pose is controlled, position [m] first; raises MessageError if they cannot be."""

NO_POSES: Mapping[str, PoseReader] = MappingProxyType({})
"""Readers of a robot whose hands are asked for positions alone."""

_Reader: TypeAlias = Callable[[bytes], tuple[int, Any]]
_Places: TypeAlias = np.ndarray[tuple[int], np.dtype[np.intp]] | slice

_RECORD, _VALUE = itemgetter(0), itemgetter(1)  # of what the stamp joiner returns for a message

_MAX_LAYOUTS = 64
_MAX_TOPICS = 64
_REMEMBERED = 8192  # messages of each kind, a few MB
_MAX_REMEMBERED_SIZE = 2048  # bytes: 15 joints take 460


class Tick(NamedTuple):
    """One sample: positions of hands and the joints measured, all at the same instant.

    Attributes
    ----------
    stamp_ns : int
        The stamp that all its messages carry [ns].
    hands : tuple of array, shape (3,) or (6,) each
        Positions [m], read-only, in the order of the tick's topics: as commanded, or as measured; of a hand whose pose
        is controlled, its turn [rad] too.
    joints : JointState
        Joints at the tick.
    records : tuple of RecordedMessage
        The messages themselves, in the order of the tick's topics.
    """

    stamp_ns: int
    hands: tuple[FloatArray, ...]
    joints: JointState
    records: tuple[RecordedMessage, ...]


def pass_all(value: FloatArray | JointState) -> None:
    """Let every position and all joints pass, where no robot is known that they could be of."""


class TickJoiner:
    """Joins the messages of one cycle to ticks.

    Within a tick the messages may come in any order, and topics may run ahead of one another; on each topic stamps
    must grow. Messages on other topics are passed over, and so are hands as measured where there are no joints, as
    robots publish them more often. Between cycles, which repeat the stamps, call `finish` (the
    cycle is over) or `clear` (it is given up).

    Parameters
    ----------
    check : callable
        What is asked of a position or of joints beyond finite numbers in a position.
    topics : sequence of str
        The topics that a tick has a message of each: hands in the order wanted, and the joints.
    poses : mapping of str to callable
        Readers of the topics of hands whose pose is controlled.
    """

    def __init__(
        self,
        check: Check = pass_all,
        topics: Sequence[str] = COMMANDED_TICK,
        poses: Mapping[str, PoseReader] = NO_POSES,
    ) -> None:
        self._check = check
        self._topics = tuple(topics)
        self._inputs = {topic: (rank, TickInput(topic, poses.get(topic))) for rank, topic in enumerate(self._topics)}
        self._joints = joints_rank(self._topics)
        self._surplus = [is_measured(topic) for topic in self._topics]
        self._ticks: StampJoiner[Any] = StampJoiner(self._topics, limit=MAX_OPEN, give_up=self._refuse_incomplete)
        self._last = [-1] * len(self._topics)

    def feed(self, record: RecordedMessage) -> tuple[Tick, ...]:
        """Take in one message and return the tick that it completes, if any.

        Raises
        ------
        MessageError
            If the message has the wrong type, does not decode, holds NaN or infinity in a target, comes twice or out
            of order, or completes a tick while an earlier one lacks a message; or if it does not pass the check.
        JointError
            If its joints do not pass the check.
        """
        known = self._inputs.get(record.topic)
        if known is None:
            return ()
        rank, tick_input = known
        stamp, value = tick_input.read(record)
        try:
            self._check(value)
        except (JointError, MessageError) as error:
            raise type(error)(f"{name_of(record)}: {error}") from None
        if stamp <= self._last[rank]:
            raise _out_of_order(record, stamp, self._last[rank])
        self._last[rank] = stamp
        parts = self._ticks.add(stamp, rank, record, value)
        if parts is None:
            return ()
        hands = [*map(_VALUE, parts)]
        joints = hands.pop(self._joints)
        return (Tick(stamp, tuple(hands), joints, tuple(map(_RECORD, parts))),)

    @property
    def idle(self) -> bool:
        """Whether no tick waits for more of its messages."""
        return not self._ticks.open

    def finish(self) -> None:
        """End the cycle; raises MessageError, naming what is missing, if a tick is not complete."""
        try:
            for stamp, tick in self._ticks.waiting():
                self._refuse_incomplete(stamp, tick, "the cycle is over")
        finally:
            self.clear()

    def clear(self) -> None:
        """Forget the messages of unfinished ticks and begin a new cycle."""
        self._ticks.clear()
        self._last = [-1] * len(self._topics)

    def _refuse_incomplete(self, stamp: int, tick: OpenTick, but: str) -> None:
        if all(part is None or surplus for part, surplus in zip(tick, self._surplus, strict=True)):
            return
        absent, present = self._ticks.absent(tick), [name_of(record) for record, _ in filter(None, tick)]
        raise MessageError(
            f"the tick at {stamp} ns lacks {names_text(absent)}: it has {names_text(present)}, and {but}"
        )


def join_ticks(
    records: Iterable[RecordedMessage],
    check: Check = pass_all,
    topics: Sequence[str] = COMMANDED_TICK,
    poses: Mapping[str, PoseReader] = NO_POSES,
) -> Iterator[Tick]:
    """Yield the ticks of one cycle, such as a whole episode log.

    Raises
    ------
    MessageError, JointError
        As `TickJoiner.feed` and `TickJoiner.finish` do.
    """
    joiner = TickJoiner(check, topics, poses)
    for record in records:
        yield from joiner.feed(record)
    joiner.finish()


class JointMap:
    """Picks joints out of messages by name, in a fixed order; a message may hold other joints too.

    What those are called is not looked at.

    Parameters
    ----------
    names : iterable of str
        The joints wanted, in the order wanted, length n.

    Raises
    ------
    JointError
        If a name is asked for twice.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self._places: dict[tuple[str, ...], _Places] = {}
        _refuse_repeated(self.names, self.names, "the joints asked for")

    def positions(self, joints: JointState) -> FloatArray:
        """Return the joint positions [rad or m] in the order of `names`, shape (n,), read-only.

        Raises
        ------
        JointError
            If a joint that is asked for is missing or occurs twice in the message, or the message holds no positions.
        """
        places = self._places.get(joints.name)
        if places is None:
            places = self._find(joints.name)
        if len(joints.position) != len(joints.name):
            raise JointError(f"expected {len(joints.name)} joint positions, found {len(joints.position)}")
        return read_only(joints.position[places])

    def _find(self, found: tuple[str, ...]) -> _Places:
        _refuse_repeated(self.names, found, "the joints of the message")
        at = {name: place for place, name in enumerate(found)}
        missing = [name for name in self.names if name not in at]
        if missing:
            raise JointError(f"no joint {names_text(missing)} in the message; there are: {names_text(found) or 'none'}")
        if len(self._places) >= _MAX_LAYOUTS:
            self._places.clear()
        in_order = found == self.names  # nothing is copied then
        places: _Places = slice(None) if in_order else np.array([at[name] for name in self.names], dtype=np.intp)
        self._places[found] = places
        return places


def _refuse_repeated(wanted: tuple[str, ...], found: tuple[str, ...], what: str) -> None:
    counts = Counter(found)
    repeated = sorted({name for name in wanted if counts[name] > 1})
    if repeated:
        raise JointError(f"{names_text(repeated)} twice among {what}: {names_text(found)}")


class TickInput:
    """Reads the messages of one topic of a tick.

    Parameters
    ----------
    topic : str
        The topic, one of hands or joints.
    pose : callable, optional
        Reads the messages of a hand whose pose is controlled; of others the orientation is not looked at.
    """

    def __init__(self, topic: str, pose: PoseReader | None = None) -> None:
        self._type = type_of(topic)
        self._read, self._read_remembered = _READERS[self._type]
        if pose is not None:
            self._read = partial(_read_pose, pose)
            self._read_remembered = lru_cache(maxsize=_REMEMBERED)(self._read)

    def read(self, record: RecordedMessage) -> tuple[int, FloatArray | JointState]:
        """Return the stamp [ns] of a message, and the joints that it holds, or the position [m] (3,), or pose (6,).

        Raises
        ------
        MessageError
            If it has the wrong type, does not decode, or is a position that holds NaN or infinity: which of the joints
            are a robot's is not known here.
        OutOfRange
            If it holds a pose that cannot be the robot's.
        """
        if record.type != self._type:
            raise MessageError(f"{name_of(record)}: expected {self._type}, found {record.type!r}")
        data = record.data
        try:
            return self._read_remembered(data) if len(data) <= _MAX_REMEMBERED_SIZE else self._read(data)
        except OutOfRange as error:
            raise OutOfRange(f"{name_of(record)}: {error}", finite=error.finite) from None
        except MessageError as error:
            raise MessageError(f"{name_of(record)}: {error}") from None


def joints_rank(topics: Sequence[str]) -> int:
    """Return the place of the joints' topic among those of a tick."""
    return next(rank for rank, topic in enumerate(topics) if type_of(topic) == JointState.TYPE)


def check_tick_topics(topics: Sequence[str]) -> tuple[str, ...]:
    """Return topics that a tick may consist of: one of joints, all others of positions, none of them twice.

    Raises
    ------
    ConfigError
        If they are others.
    """
    types = Counter(map(type_of, topics))
    hands, joints = types[PoseStamped.TYPE], types[JointState.TYPE]
    if not 1 <= len(topics) <= _MAX_TOPICS or joints != 1 or hands + 1 != len(topics) or len(set(topics)) < len(topics):
        raise ConfigError(
            f"expected as a tick's topics hands, each once, and one of joints, found {names_text(topics) or 'none'}"
        )
    return tuple(topics)


def _read_position(data: bytes) -> tuple[int, FloatArray]:
    pose = decode_as(PoseStamped, data)
    _refuse_nan(pose.position, pose.stamp_ns)
    return pose.stamp_ns, pose.position


def _read_pose(read: PoseReader, data: bytes) -> tuple[int, FloatArray]:
    pose = decode_as(PoseStamped, data)
    _refuse_nan(pose.position, pose.stamp_ns)
    return pose.stamp_ns, read(pose)


def _read_joints(data: bytes) -> tuple[int, JointState]:
    joints = decode_as(JointState, data)
    return joints.stamp_ns, joints


def _refuse_nan(values: FloatArray, stamp: int) -> None:
    numbers = values.tolist()
    if isfinite(sum(numbers)):  # a NaN or an infinity never leaves a finite sum
        return
    for number in numbers:  # but finite numbers may overflow it
        if not isfinite(number):
            raise MessageError(f"expected finite numbers at {stamp} ns, found {number}")


def _out_of_order(record: RecordedMessage, stamp: int, last: int) -> MessageError:
    if stamp == last:
        return MessageError(f"{name_of(record)}: a second message at {stamp} ns, expected one per tick")
    return MessageError(f"{name_of(record)}: stamp {stamp} ns runs backwards, the one before was {last} ns")


# Training feeds the same episode hundreds of times, so the latest messages are remembered by their bytes, which is
# safe because what is decoded cannot be changed.
_remembered_position = lru_cache(maxsize=_REMEMBERED)(_read_position)
_remembered_joints = lru_cache(maxsize=_REMEMBERED)(_read_joints)

# By type: how to read a message, and how to read one that may come again.
_READERS: dict[str, tuple[_Reader, _Reader]] = {
    JointState.TYPE: (_read_joints, _remembered_joints),
    PoseStamped.TYPE: (_read_position, _remembered_position),
}
