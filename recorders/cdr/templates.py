"""Byte templates: the fast path of the codec for JointState and PoseStamped, which fill a session.

Two messages of one layout (same names, frame and array sizes) differ only in the stamp and in runs of float64. A
template keeps the bytes between those runs: encoding joins them with the new values, decoding checks that they are
there and looks at the runs in place. Each template is checked once, when it is made, against the bytes of rosbags.
"""

import struct
from typing import TypeAlias, TypeVar

import numpy as np

from recorders.cdr.layouts import write_message
from recorders.cdr.rosbags_types import reference_cdr
from recorders.cdr.stream import ENCAPSULATION
from recorders.errors import MessageError
from recorders.messages.message_types import EMPTY, JointState, PoseStamped
from recorders.messages.validation import FloatArray

Templated: TypeAlias = JointState | PoseStamped
Layout: TypeAlias = tuple[object, ...]
Position: TypeAlias = tuple[float, float, float]

_Key = TypeVar("_Key")
_Cached = TypeVar("_Cached", bound="JointTemplate | PoseTemplate")

_PREFIX = struct.Struct("<4siI")  # encapsulation, stamp in s and ns
_POSITION = struct.Struct("<3d")
_FLOAT64 = np.dtype("<f8")
_SECOND = 10**9
_MAX_TEMPLATES = 256  # a session has a handful of layouts; a hostile stream must not fill the memory

# Decoded messages are built without their constructors, which would copy and check what is already known to be right.
_new = object.__new__
_joint_fields = ("stamp_ns", "name", "position", "velocity", "effort", "frame_id")
_set_stamp, _set_name, _set_position, _set_velocity, _set_effort, _set_frame = (
    getattr(JointState, field).__set__ for field in _joint_fields
)
_set_pose_stamp, _set_pose_position, _set_orientation, _set_pose_frame = (
    getattr(PoseStamped, field).__set__ for field in ("stamp_ns", "position", "orientation", "frame_id")
)


def read_stamp(data: bytes) -> int | None:
    """Return the stamp [ns] with which little-endian CDR begins; None if it does not, as the general codec may."""
    if len(data) < _PREFIX.size:
        return None
    encapsulation, seconds, nanoseconds = _PREFIX.unpack_from(data)
    if encapsulation != ENCAPSULATION or seconds < 0 or nanoseconds >= _SECOND:
        return None
    stamp: int = seconds * _SECOND + nanoseconds
    return stamp


class _Template:
    """The constant bytes of one layout, taken from a message of that layout and checked against rosbags.

    Attributes
    ----------
    gaps : list of bytes
        What stands before each run of floats (the first counted from the end of the stamp); nothing follows the last.
    starts : list of int
        Where each run of floats stands, counted from the fifth byte of the payload.
    constants : list of (bytes, int)
        The gaps, those that touch joined, and where they stand in the payload.
    """

    def __init__(self, message: Templated) -> None:
        written = write_message(message)
        payload = written.payload()
        if payload != reference_cdr(message):
            raise MessageError(f"{message.TYPE}: our codec and rosbags disagree on the bytes of {message!r}")
        self.frame_id = message.frame_id
        self.starts = [start for start, _ in written.runs]
        ends = [_PREFIX.size, *(end + len(ENCAPSULATION) for _, end in written.runs[:-1])]
        spans = [(end, start + len(ENCAPSULATION)) for end, start in zip(ends, self.starts, strict=True)]
        self.gaps = [payload[start:end] for start, end in spans]
        self.constants = [(payload[start:end], start) for start, end in _join(spans) if start < end]


def _join(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join spans that touch, which saves a comparison for each absent array."""
    joined = spans[:1]
    for start, end in spans[1:]:
        if joined[-1][1] == start:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((start, end))
    return joined


class JointTemplate(_Template):
    """The layout of a JointState: names, frame, and which of the arrays are there."""

    def __init__(self, message: JointState) -> None:
        super().__init__(message)
        self.name = message.name
        self.counts = len(message.position), len(message.velocity), len(message.effort)

    def encode(self, message: JointState) -> bytes:
        """Return the payload of a message of this layout."""
        seconds, nanoseconds = divmod(message.stamp_ns, _SECOND)
        names, velocity_count, effort_count = self.gaps
        return b"".join(
            (
                _PREFIX.pack(ENCAPSULATION, seconds, nanoseconds),
                names,
                message.position.tobytes(),
                velocity_count,
                message.velocity.tobytes(),
                effort_count,
                message.effort.tobytes(),
            )
        )

    def decode(self, data: bytes) -> JointState | None:
        """Return the message, None if `data` is not of this layout; its arrays are read-only and aligned."""
        encapsulation, seconds, nanoseconds = _PREFIX.unpack_from(data)
        if encapsulation != ENCAPSULATION or seconds < 0 or nanoseconds >= _SECOND:
            return None
        for constant, place in self.constants:
            if not data.startswith(constant, place):
                return None
        body = data[4:]  # a copy, in which floats stand at multiples of 8
        position, velocity, effort = self.counts
        at_position, at_velocity, at_effort = self.starts
        message = _new(JointState)
        _set_stamp(message, seconds * _SECOND + nanoseconds)
        _set_name(message, self.name)
        _set_frame(message, self.frame_id)
        _set_position(message, np.frombuffer(body, _FLOAT64, position, at_position) if position else EMPTY)
        _set_velocity(message, np.frombuffer(body, _FLOAT64, velocity, at_velocity) if velocity else EMPTY)
        _set_effort(message, np.frombuffer(body, _FLOAT64, effort, at_effort) if effort else EMPTY)
        return message


class PoseTemplate(_Template):
    """The layout of a PoseStamped: its frame."""

    def __init__(self, message: PoseStamped) -> None:
        super().__init__(message)
        self._head = self.starts[0] + len(ENCAPSULATION)
        self._size = self.starts[1] + 4 * _FLOAT64.itemsize + len(ENCAPSULATION)

    def read_pair(self, left: bytes, right: bytes) -> tuple[int, Position, Position] | None:
        """Return stamp [ns] and positions [m] of two poses of one stamp; None if they are not both of this layout."""
        head, size = self._head, self._size
        if len(left) != size or len(right) != size or left[:head] != right[:head]:
            return None
        stamp = read_stamp(left)
        if stamp is None or not left.startswith(self.gaps[0], _PREFIX.size):
            return None
        return stamp, _POSITION.unpack_from(left, head), _POSITION.unpack_from(right, head)

    def encode(self, message: PoseStamped) -> bytes:
        """Return the payload of a message of this layout."""
        seconds, nanoseconds = divmod(message.stamp_ns, _SECOND)
        prefix = _PREFIX.pack(ENCAPSULATION, seconds, nanoseconds)
        return b"".join((prefix, self.gaps[0], message.position.tobytes(), message.orientation.tobytes()))

    def decode(self, data: bytes) -> PoseStamped | None:
        """Return the message, None if `data` is not of this layout; its arrays are read-only and aligned."""
        encapsulation, seconds, nanoseconds = _PREFIX.unpack_from(data)
        if encapsulation != ENCAPSULATION or seconds < 0 or nanoseconds >= _SECOND:
            return None
        for constant, place in self.constants:
            if not data.startswith(constant, place):
                return None
        body = data[4:]  # a copy, in which floats stand at multiples of 8
        at_position, at_orientation = self.starts
        message = _new(PoseStamped)
        _set_pose_stamp(message, seconds * _SECOND + nanoseconds)
        _set_pose_frame(message, self.frame_id)
        _set_pose_position(message, np.frombuffer(body, _FLOAT64, 3, at_position))
        _set_orientation(message, np.frombuffer(body, _FLOAT64, 4, at_orientation))
        return message


_joints: dict[Layout, JointTemplate] = {}
_poses: dict[Layout, PoseTemplate] = {}
_by_size: dict[tuple[str, int], JointTemplate | PoseTemplate] = {}


def encode_joints(message: JointState) -> bytes:
    """Return the CDR payload of a JointState."""
    return _joint_template(message).encode(message)


def encode_pose(message: PoseStamped) -> bytes:
    """Return the CDR payload of a PoseStamped."""
    return _pose_template(message).encode(message)


def decode_known(type_name: str, data: bytes) -> Templated | None:
    """Decode a payload whose layout was met before; None if it was not, or if anything about it is unusual."""
    template = _by_size.get((type_name, len(data)))
    return template.decode(data) if template else None


def pose_layout() -> PoseTemplate:
    """Return the layout of poses in the world frame."""
    return _pose_template(PoseStamped(0, np.zeros(3)))


class PositionEncoder:
    """Encodes JointStates of the same joints that hold positions alone, without making messages.

    Parameters
    ----------
    names : tuple of str
        The n joints.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        head, *counts = _joint_template(JointState(0, names, np.zeros(len(names)))).gaps
        self._head, self._tail = head, b"".join(counts)

    def encode(self, stamp_ns: int, position: FloatArray) -> bytes:
        """Return the payload of a stamp [ns] and positions [rad, m], float64 and contiguous, shape (n,)."""
        seconds, nanoseconds = divmod(stamp_ns, _SECOND)
        prefix = _PREFIX.pack(ENCAPSULATION, seconds, nanoseconds)
        return prefix + self._head + position.tobytes() + self._tail


def learn_layout(message: Templated, data: bytes) -> None:
    """Remember the layout of a payload that the general codec has decoded, if it is the one that we would write."""
    if data == write_message(message).payload():
        template = _joint_template(message) if isinstance(message, JointState) else _pose_template(message)
        _keep(_by_size, (message.TYPE, len(data)), template)


def _joint_template(message: JointState) -> JointTemplate:
    layout = message.name, message.frame_id, len(message.position), len(message.velocity), len(message.effort)
    return _joints.get(layout) or _keep(_joints, layout, JointTemplate(message))


def _pose_template(message: PoseStamped) -> PoseTemplate:
    layout = (message.frame_id,)
    return _poses.get(layout) or _keep(_poses, layout, PoseTemplate(message))


def _keep(templates: dict[_Key, _Cached], key: _Key, template: _Cached) -> _Cached:
    if len(templates) >= _MAX_TEMPLATES:
        templates.clear()
    templates[key] = template
    return template
