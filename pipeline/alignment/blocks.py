"""Messages of one topic read many at a time: those of one layout as one array, all others one by one."""

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats
from pipeline.rotations import SHORTEST, length
from recorders.cdr.codec import decode_as
from recorders.cdr.layouts import write_message
from recorders.cdr.stream import ENCAPSULATION
from recorders.errors import MessageError
from recorders.messages.message_types import JointState, PoseStamped

Times: TypeAlias = NDArray[np.int64]
Bytes: TypeAlias = NDArray[np.uint8]

_MAX_LAYOUTS = 64
_SECOND = 10**9
_STAMP = slice(4, 12)  # of a payload: seconds and nanoseconds, 4 bytes each


class Dropped(IntEnum):
    """Reasons why a message is no sample; 0 is none."""

    NOT = 0
    UNREADABLE = 1
    JOINTS_MISSING = 2
    NOT_FINITE = 3
    NO_LENGTH = 4
    UNKNOWN_FRAME = 5
    NO_STAMP = 6
    LATE = 7
    OUT_OF_RANGE = 8
    AHEAD = 9
    NO_LOG_TIME = 10

    @property
    def text(self) -> str:
        """The reason in words."""
        return _TEXTS[self]


_TEXTS = {
    Dropped.NOT: "used",
    Dropped.UNREADABLE: "unreadable",
    Dropped.JOINTS_MISSING: "without all joints of the robot",
    Dropped.NOT_FINITE: "with a number that is not finite",
    Dropped.NO_LENGTH: "with a quaternion of zero length",
    Dropped.UNKNOWN_FRAME: "in a frame that is not known yet",
    Dropped.NO_STAMP: "without a stamp",
    Dropped.LATE: "late, no later by stamp than one before",
    Dropped.OUT_OF_RANGE: "with a time outside 0 to 2^31 s",
    Dropped.NO_LOG_TIME: "recorded at time 0",
    Dropped.AHEAD: "more than 60 s ahead of all before, with none that goes on there",
}


class Block(NamedTuple):
    """Messages of one topic in order of arrival.

    Attributes
    ----------
    stamps_ns : ndarray, shape (m,)
        Their stamps [ns], -1 where none can be read.
    values : ndarray, shape (m, d)
        What they hold.
    dropped : ndarray, shape (m,)
        A `Dropped` for each.
    frames : dict of str to ndarray
        Frames that they are in, and the indices of those that are.
    """

    stamps_ns: Times
    values: Floats
    dropped: NDArray[np.int8]
    frames: dict[str, NDArray[np.intp]]


class Kind(NamedTuple):
    """Kind of message that is aligned.

    Attributes
    ----------
    message : type
        Its class.
    size : int
        How many values a sample has.
    places : callable
        Returns the places of the values among the floats of a message's first runs, None if they are not there.
    """

    message: type[JointState] | type[PoseStamped]
    size: int
    places: Callable[[JointState | PoseStamped], NDArray[np.intp] | None]


def joints_kind(joints: Sequence[str]) -> Kind:
    """Return the kind of messages that hold joints, of which some are wanted, in this order [rad or m]."""
    wanted = tuple(joints)

    def places(message: JointState | PoseStamped) -> NDArray[np.intp] | None:
        """Return where the joints are in a message."""
        assert isinstance(message, JointState)  # noqa: S101  # of the kind
        at = {name: place for place, name in enumerate(message.name)}
        if len(message.position) != len(message.name) or len(at) != len(message.name) or not at.keys() >= set(wanted):
            return None
        return np.array([at[name] for name in wanted], dtype=np.intp)

    return Kind(JointState, len(wanted), places)


def pose_kind() -> Kind:
    """Return the kind of messages that hold a pose: position [m] and unit quaternion (x, y, z, w)."""
    return Kind(PoseStamped, 7, lambda message: np.arange(7))


class _Layout(NamedTuple):
    """Bytes of the messages of one layout.

    Attributes
    ----------
    size : int
        Bytes of a message.
    constants : list of (slice, ndarray)
        Bytes that are the same in all.
    floats : tuple of slice
        Where the floats are that hold the values.
    places : ndarray or None
        Places of the values among these, None if they are not there.
    frame_id : str
        The frame.
    """

    size: int
    constants: list[tuple[slice, Bytes]]
    floats: tuple[slice, ...]
    places: NDArray[np.intp] | None
    frame_id: str

    @classmethod
    def of(cls, kind: Kind, data: bytes) -> "_Layout | None":
        """Return the layout of a message that is written as we would write it; None if it is not."""
        message = decode_as(kind.message, data)
        written = write_message(message)
        if written.payload() != data:
            return None
        spans = [slice(start + len(ENCAPSULATION), end + len(ENCAPSULATION)) for start, end in written.runs]
        starts, ends = [0, _STAMP.stop, *(span.stop for span in spans)], [_STAMP.start, *(span.start for span in spans)]
        whole = np.frombuffer(data, np.uint8)
        gaps = [slice(start, end) for start, end in zip(starts, [*ends, len(data)], strict=True) if start < end]
        floats = spans[:1] if isinstance(message, JointState) else spans
        return cls(len(data), [(gap, whole[gap]) for gap in gaps], (*floats,), kind.places(message), message.frame_id)


class BlockReader:
    """Reads the messages of one topic.

    Parameters
    ----------
    kind : Kind
        Their kind.
    """

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        self._layouts: dict[int, _Layout] = {}
        self.first_error = ""

    def read(self, payloads: Sequence[bytes]) -> Block:
        """Return stamps and values of messages, in order of arrival; what is no sample is noted."""
        count = len(payloads)
        block = Block(np.full(count, -1, np.int64), np.zeros((count, self._kind.size)), np.zeros(count, np.int8), {})
        sizes = np.fromiter(map(len, payloads), np.intp, count)
        for size in np.unique(sizes).tolist():
            self._read_alike(payloads, size, np.flatnonzero(sizes == size), block)
        self._check(block)
        return block

    def _read_alike(self, payloads: Sequence[bytes], size: int, indices: NDArray[np.intp], block: Block) -> None:
        """Read messages of one size; those that are not of the layout known for it one by one."""
        layout = self._layouts.get(size) or self._learn(payloads[indices[0]])
        if layout is not None:
            chosen = payloads if len(indices) == len(payloads) else [payloads[index] for index in indices.tolist()]
            rows = np.frombuffer(b"".join(chosen), np.uint8).reshape(len(indices), size)
            alike = np.ones(len(indices), np.bool_)
            for where, constant in layout.constants:
                alike &= (rows[:, where] == constant).all(axis=1)
            _fill(block, indices[alike], rows[alike], layout)
            indices = indices[~alike]
        for index in indices.tolist():
            self._read_one(payloads[index], index, block)

    def _learn(self, data: bytes) -> _Layout | None:
        try:
            layout = _Layout.of(self._kind, data)
        except MessageError:
            return None
        if layout is not None:
            if len(self._layouts) >= _MAX_LAYOUTS:
                self._layouts.clear()
            self._layouts[layout.size] = layout
        return layout

    def _read_one(self, data: bytes, index: int, block: Block) -> None:
        try:
            message = decode_as(self._kind.message, data)
        except MessageError as error:
            self.first_error = self.first_error or str(error)
            block.dropped[index] = Dropped.UNREADABLE
            return
        block.stamps_ns[index] = message.stamp_ns
        _note_frame(block, message.frame_id, np.array([index], np.intp))
        places = self._kind.places(message)
        if places is None:
            block.dropped[index] = Dropped.JOINTS_MISSING
            return
        if isinstance(message, JointState):
            block.values[index] = message.position[places]
        else:
            block.values[index] = np.concatenate((message.position, message.orientation))

    def _check(self, block: Block) -> None:
        """Note what is not finite and has no direction, and give quaternions length 1."""
        fine = block.dropped == Dropped.NOT
        block.dropped[fine & ~np.isfinite(block.values).all(axis=1)] = Dropped.NOT_FINITE
        if self._kind.message is PoseStamped:
            fine, turns = block.dropped == Dropped.NOT, block.values[:, 3:]
            with np.errstate(over="ignore", invalid="ignore"):  # what is too large or no number is noted
                lengths = length(turns)
            turned = fine & (lengths >= SHORTEST) & np.isfinite(lengths)
            block.dropped[fine & ~turned] = Dropped.NO_LENGTH
            turns[turned] /= lengths[turned, None]


def _fill(block: Block, indices: NDArray[np.intp], rows: Bytes, layout: _Layout) -> None:
    """Take in messages of one layout, of which `rows` are the bytes."""
    times = np.ascontiguousarray(rows[:, _STAMP]).view("<u4").astype(np.int64)
    seconds, rest = times[:, 0], times[:, 1]
    readable = (seconds < 2**31) & (rest < _SECOND)
    block.stamps_ns[indices] = np.where(readable, seconds * _SECOND + rest, -1)
    block.dropped[indices[~readable]] = Dropped.UNREADABLE
    _note_frame(block, layout.frame_id, indices)
    if layout.places is None:
        block.dropped[indices[readable]] = Dropped.JOINTS_MISSING
        return
    found = np.concatenate([np.ascontiguousarray(rows[:, where]) for where in layout.floats], axis=1)
    block.values[indices] = found.view("<f8")[:, layout.places]


def _note_frame(block: Block, frame_id: str, indices: NDArray[np.intp]) -> None:
    earlier = block.frames.get(frame_id)
    block.frames[frame_id] = indices if earlier is None else np.concatenate((earlier, indices))
