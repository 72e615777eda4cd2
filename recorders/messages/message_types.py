"""The messages of the log: frozen dataclasses for the standard ROS 2 types in use, with copied, read-only arrays."""

from dataclasses import KW_ONLY, dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias

import numpy as np

from recorders.messages.validation import (
    UINT32_MAX,
    FloatArray,
    integer,
    items,
    names,
    read_only,
    stamp,
    store,
    text,
    vector,
    wrong,
)

EMPTY = read_only(np.empty(0))
ORIGIN = read_only(np.zeros(3))
IDENTITY = read_only(np.array([0.0, 0.0, 0.0, 1.0]))  # quaternion x, y, z, w


class Dimension(NamedTuple):
    """One dimension of a `Float64MultiArray` layout."""

    label: str
    size: int
    stride: int


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Joints by name at one instant (sensor_msgs/msg/JointState).

    Parameters
    ----------
    stamp_ns : int
        Producer's time [ns], 0 to 2^31 s.
    name : tuple of str
        Joint names, length n.
    position : array, shape (n,) or (0,)
        Joint positions [rad or m].
    velocity, effort : array, shape (n,) or (0,)
        Joint velocities [rad/s or m/s] and efforts [N m or N].
    frame_id : str
        Usually empty for joints.

    Raises
    ------
    MessageError
        If a field has the wrong type or an array does not match the names.
    """

    TYPE: ClassVar[str] = "sensor_msgs/msg/JointState"
    stamp_ns: int
    name: tuple[str, ...]
    position: FloatArray
    _: KW_ONLY
    velocity: FloatArray = field(default_factory=lambda: EMPTY)
    effort: FloatArray = field(default_factory=lambda: EMPTY)
    frame_id: str = ""

    def __post_init__(self) -> None:
        """Check every field and copy the arrays."""
        store(self, "stamp_ns", stamp(self, "stamp_ns", self.stamp_ns))
        store(self, "name", names(self, self.name))
        for part in ("position", "velocity", "effort"):
            array = vector(self, part, getattr(self, part))
            if len(array) not in (0, len(self.name)):
                raise wrong(self, part, f"{len(self.name)} values, one per joint name", f"{len(array)}")
            store(self, part, array)
        text(self, "frame_id", self.frame_id)


@dataclass(frozen=True, slots=True, eq=False)
class PoseStamped:
    """A pose at one instant (geometry_msgs/msg/PoseStamped).

    Parameters
    ----------
    stamp_ns : int
        Producer's time [ns], 0 to 2^31 s.
    position : array, shape (3,)
        Position in `frame_id` [m].
    orientation : array, shape (4,)
        Quaternion x, y, z, w.
    frame_id : str
        Frame in which the pose is given.

    Raises
    ------
    MessageError
        If a field has the wrong type or shape.
    """

    TYPE: ClassVar[str] = "geometry_msgs/msg/PoseStamped"
    stamp_ns: int
    position: FloatArray
    _: KW_ONLY
    orientation: FloatArray = field(default_factory=lambda: IDENTITY)
    frame_id: str = "world"

    def __post_init__(self) -> None:
        """Check every field and copy the arrays."""
        store(self, "stamp_ns", stamp(self, "stamp_ns", self.stamp_ns))
        store(self, "position", vector(self, "position", self.position, 3))
        store(self, "orientation", vector(self, "orientation", self.orientation, 4))
        text(self, "frame_id", self.frame_id)


@dataclass(frozen=True, slots=True, eq=False)
class String:
    """A text, often JSON (std_msgs/msg/String); raises MessageError if `data` is no UTF-8 text."""

    TYPE: ClassVar[str] = "std_msgs/msg/String"
    data: str

    def __post_init__(self) -> None:
        """Check that the text can be written as UTF-8."""
        text(self, "data", self.data)


@dataclass(frozen=True, slots=True, eq=False)
class Float64MultiArray:
    """A row of numbers (std_msgs/msg/Float64MultiArray).

    Parameters
    ----------
    data : array, shape (n,)
        The numbers; their unit is the topic's.
    dims : tuple of Dimension
        How to read `data` as an array of more dimensions; empty for a plain row.
    data_offset : int
        Padding elements at the front of `data`.

    Raises
    ------
    MessageError
        If a field has the wrong type or shape.
    """

    TYPE: ClassVar[str] = "std_msgs/msg/Float64MultiArray"
    data: FloatArray
    _: KW_ONLY
    dims: tuple[Dimension, ...] = ()
    data_offset: int = 0

    def __post_init__(self) -> None:
        """Check every field and copy the array."""
        store(self, "data", vector(self, "data", self.data))
        store(self, "dims", tuple(_dimension(self, dim) for dim in items(self, "dims", self.dims)))
        integer(self, "data_offset", self.data_offset, UINT32_MAX)


@dataclass(frozen=True, slots=True, eq=False)
class TransformStamped:
    """The pose of one frame in another at one instant (geometry_msgs/msg/TransformStamped).

    Parameters
    ----------
    stamp_ns : int
        Producer's time [ns], 0 to 2^31 s.
    frame_id, child_frame_id : str
        Parent and child frame.
    translation : array, shape (3,)
        Origin of the child in the parent [m].
    rotation : array, shape (4,)
        Quaternion x, y, z, w of the child in the parent.

    Raises
    ------
    MessageError
        If a field has the wrong type or shape.
    """

    TYPE: ClassVar[str] = "geometry_msgs/msg/TransformStamped"
    stamp_ns: int
    frame_id: str
    child_frame_id: str
    translation: FloatArray = field(default_factory=lambda: ORIGIN)
    rotation: FloatArray = field(default_factory=lambda: IDENTITY)

    def __post_init__(self) -> None:
        """Check every field and copy the arrays."""
        store(self, "stamp_ns", stamp(self, "stamp_ns", self.stamp_ns))
        text(self, "frame_id", self.frame_id)
        text(self, "child_frame_id", self.child_frame_id)
        store(self, "translation", vector(self, "translation", self.translation, 3))
        store(self, "rotation", vector(self, "rotation", self.rotation, 4))


@dataclass(frozen=True, slots=True, eq=False)
class TFMessage:
    """Several transforms (tf2_msgs/msg/TFMessage); raises MessageError if one is no `TransformStamped`."""

    TYPE: ClassVar[str] = "tf2_msgs/msg/TFMessage"
    transforms: tuple[TransformStamped, ...]

    def __post_init__(self) -> None:
        """Check the type of every transform."""
        transforms = tuple(items(self, "transforms", self.transforms))
        for transform in transforms:
            if not isinstance(transform, TransformStamped):
                raise wrong(self, "transforms", "TransformStamped", type(transform).__name__)
        store(self, "transforms", transforms)


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The simulation's time [ns] (rosgraph_msgs/msg/Clock); raises MessageError if it is out of range."""

    TYPE: ClassVar[str] = "rosgraph_msgs/msg/Clock"
    clock_ns: int

    def __post_init__(self) -> None:
        """Check the range of the time."""
        store(self, "clock_ns", stamp(self, "clock_ns", self.clock_ns))


class TypedMessage(Protocol):
    """Message of any registered type: of one of these, or of others' (see `recorders.cdr.message_format`)."""

    TYPE: ClassVar[str]


Message: TypeAlias = JointState | PoseStamped | String | Float64MultiArray | TransformStamped | TFMessage | Clock
"""A message of any of these types."""

MESSAGE_TYPES: dict[str, type[Message]] = {
    cls.TYPE: cls for cls in (JointState, PoseStamped, String, Float64MultiArray, TransformStamped, TFMessage, Clock)
}


def _dimension(message: object, value: Any) -> Dimension:
    if not isinstance(value, tuple) or len(value) != len(Dimension._fields):
        raise wrong(message, "dims", "(label, size, stride)", repr(value))
    label, size, stride = value
    return Dimension(
        text(message, "dims.label", label),
        integer(message, "dims.size", size, UINT32_MAX),
        integer(message, "dims.stride", stride, UINT32_MAX),
    )
