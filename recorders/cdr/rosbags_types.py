"""The door to rosbags: schema texts of ROS 2 types, and reference CDR bytes to check our own codec against."""

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from recorders.errors import MessageError
from recorders.messages.message_types import (
    Clock,
    Float64MultiArray,
    JointState,
    Message,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.messages.validation import FloatArray

_SECOND = 10**9


@cache
def typestore() -> Typestore:
    """Return rosbags' table of the standard ROS 2 types (Humble), built on first use: it takes 0.1 s."""
    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def schema_text(type_name: str) -> str:
    """Return the `ros2msg` definition of a type, with those of the types that it contains.

    Raises
    ------
    MessageError
        If ROS 2 has no such standard type.
    """
    store = typestore()
    if type_name not in store.fielddefs:
        raise MessageError(f"expected a standard ROS 2 type such as {JointState.TYPE}, found {type_name!r}")
    return store.generate_msgdef(type_name, ros_version=2)[0]


def is_known(type_name: str) -> bool:
    """Whether a ROS 2 type of this name is known, and so has a schema."""
    return type_name in typestore().types


def reference_cdr(message: Message) -> bytes:
    """Return the little-endian CDR bytes that rosbags makes of a message."""
    return bytes(typestore().serialize_cdr(to_rosbags(message), message.TYPE))


def to_rosbags(message: Message) -> Any:
    """Return the same message as an instance of rosbags' class of its type."""
    match message:
        case JointState():
            arrays = (np.array(values) for values in (message.position, message.velocity, message.effort))
            return _make(message.TYPE, _header(message.stamp_ns, message.frame_id), list(message.name), *arrays)
        case PoseStamped():
            pose = _make("geometry_msgs/msg/Pose", _point(message.position), _quaternion(message.orientation))
            return _make(message.TYPE, _header(message.stamp_ns, message.frame_id), pose)
        case String():
            return _make(message.TYPE, message.data)
        case Float64MultiArray():
            dims = [_make("std_msgs/msg/MultiArrayDimension", *dim) for dim in message.dims]
            layout = _make("std_msgs/msg/MultiArrayLayout", dims, message.data_offset)
            return _make(message.TYPE, layout, np.array(message.data))
        case TransformStamped():
            return _transform(message)
        case TFMessage():
            return _make(message.TYPE, [_transform(transform) for transform in message.transforms])
        case Clock():
            return _make(message.TYPE, _time(message.clock_ns))


def _make(type_name: str, *values: Any) -> Any:
    return typestore().types[type_name](*values)


def _time(stamp_ns: int) -> Any:
    return _make("builtin_interfaces/msg/Time", *divmod(stamp_ns, _SECOND))


def _header(stamp_ns: int, frame_id: str) -> Any:
    return _make("std_msgs/msg/Header", _time(stamp_ns), frame_id)


def _point(values: FloatArray) -> Any:
    return _make("geometry_msgs/msg/Point", *values)


def _quaternion(values: FloatArray) -> Any:
    return _make("geometry_msgs/msg/Quaternion", *values)


def _transform(message: TransformStamped) -> Any:
    vector = _make("geometry_msgs/msg/Vector3", *message.translation)
    transform = _make("geometry_msgs/msg/Transform", vector, _quaternion(message.rotation))
    return _make(message.TYPE, _header(message.stamp_ns, message.frame_id), message.child_frame_id, transform)
