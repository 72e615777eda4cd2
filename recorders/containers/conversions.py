"""Messages as ours out of the fields of others' types: joints, poses and transforms, of ROS and of Foxglove."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

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

Fields: TypeAlias = Mapping[str, Any]
Conversion: TypeAlias = Callable[[Fields], Message]

_SECOND = 10**9
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanos")


def time_ns(time: Fields) -> int:
    """Return a time of ROS 1, ROS 2, Foxglove or protobuf [ns]."""
    seconds, rest = _one_of(time, _SECONDS), _one_of(time, _NANOSECONDS)
    return int(seconds) * _SECOND + int(rest)


def _one_of(fields: Fields, names: Sequence[str]) -> Any:
    return next((fields[name] for name in names if name in fields), 0)


def _stamp(fields: Fields) -> int:
    return time_ns(fields["header"]["stamp"])


def _frame(fields: Fields) -> str:
    return str(fields["header"]["frame_id"])


def _vector(fields: Fields, axes: str) -> list[float]:
    return [float(fields[axis]) for axis in axes]


def _joints(fields: Fields) -> Message:
    return JointState(
        _stamp(fields),
        tuple(fields["name"]),
        fields["position"],
        velocity=fields["velocity"],
        effort=fields["effort"],
        frame_id=_frame(fields),
    )


def _pose(stamp_ns: int, frame_id: str, pose: Fields) -> PoseStamped:
    position, orientation = _vector(pose["position"], "xyz"), _vector(pose["orientation"], "xyzw")
    return PoseStamped(stamp_ns, position, orientation=orientation, frame_id=frame_id)  # type: ignore[arg-type]


def _transform(stamp_ns: int, frame_id: str, child: str, fields: Fields) -> TransformStamped:
    translation, rotation = _vector(fields["translation"], "xyz"), _vector(fields["rotation"], "xyzw")
    return TransformStamped(stamp_ns, frame_id, child, translation, rotation)  # type: ignore[arg-type]


def _ros_transform(fields: Fields) -> TransformStamped:
    return _transform(_stamp(fields), _frame(fields), str(fields["child_frame_id"]), fields["transform"])


def _foxglove_transform(fields: Fields) -> TransformStamped:
    return _transform(
        time_ns(fields["timestamp"]), str(fields["parent_frame_id"]), str(fields["child_frame_id"]), fields
    )


def _foxglove_joints(fields: Fields) -> Message:
    joints = fields["joints"]
    columns = [[joint.get(part) for joint in joints] for part in ("position", "velocity", "effort")]
    nan = float("nan")
    position, velocity, effort = (
        [nan if value is None else float(value) for value in column] if any(v is not None for v in column) else []
        for column in columns
    )
    return JointState(
        time_ns(fields["timestamp"]),
        tuple(str(joint["name"]) for joint in joints),
        position,  # type: ignore[arg-type]
        velocity=velocity,  # type: ignore[arg-type]
        effort=effort,  # type: ignore[arg-type]
    )


def _point(stamp_ns: int, frame_id: str, point: Fields) -> PoseStamped:
    return PoseStamped(stamp_ns, _vector(point, "xyz"), frame_id=frame_id)  # type: ignore[arg-type]


_TF: Conversion = lambda fields: TFMessage(tuple(_ros_transform(part) for part in fields["transforms"]))  # noqa: E731

CONVERSIONS: dict[str, tuple[str, Conversion]] = {
    JointState.TYPE: (JointState.TYPE, _joints),
    PoseStamped.TYPE: (PoseStamped.TYPE, lambda fields: _pose(_stamp(fields), _frame(fields), fields["pose"])),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        PoseStamped.TYPE,
        lambda fields: _pose(_stamp(fields), _frame(fields), fields["pose"]["pose"]),
    ),
    "nav_msgs/msg/Odometry": (
        PoseStamped.TYPE,
        lambda fields: _pose(_stamp(fields), _frame(fields), fields["pose"]["pose"]),
    ),
    "geometry_msgs/msg/Pose": (PoseStamped.TYPE, lambda fields: _pose(0, "", fields)),
    "geometry_msgs/msg/PointStamped": (
        PoseStamped.TYPE,
        lambda fields: _point(_stamp(fields), _frame(fields), fields["point"]),
    ),
    "geometry_msgs/msg/Point": (PoseStamped.TYPE, lambda fields: _point(0, "", fields)),
    TransformStamped.TYPE: (TransformStamped.TYPE, _ros_transform),
    TFMessage.TYPE: (TFMessage.TYPE, _TF),
    "tf/msg/tfMessage": (TFMessage.TYPE, _TF),
    String.TYPE: (String.TYPE, lambda fields: String(str(fields["data"]))),
    Float64MultiArray.TYPE: (
        Float64MultiArray.TYPE,
        lambda fields: Float64MultiArray(
            fields["data"],
            dims=tuple((dim["label"], dim["size"], dim["stride"]) for dim in fields["layout"]["dim"]),  # type: ignore[misc]
            data_offset=fields["layout"]["data_offset"],
        ),
    ),
    Clock.TYPE: (Clock.TYPE, lambda fields: Clock(time_ns(fields["clock"]))),
    "foxglove.JointStates": (JointState.TYPE, _foxglove_joints),
    "foxglove.PoseInFrame": (
        PoseStamped.TYPE,
        lambda fields: _pose(time_ns(fields["timestamp"]), str(fields["frame_id"]), fields["pose"]),
    ),
    "foxglove.Pose": (PoseStamped.TYPE, lambda fields: _pose(0, "", fields)),
    "foxglove.Point3InFrame": (
        PoseStamped.TYPE,
        lambda fields: _point(time_ns(fields["timestamp"]), str(fields["frame_id"]), fields["point"]),
    ),
    "foxglove.FrameTransform": (TransformStamped.TYPE, _foxglove_transform),
    "foxglove.FrameTransforms": (
        TFMessage.TYPE,
        lambda fields: TFMessage(tuple(_foxglove_transform(part) for part in fields["transforms"])),
    ),
}
"""Types that are needed: as which of our types each comes out, and how, out of its fields.

A pose or point without a stamp comes out with the stamp 0.
"""


def convert(type_name: str, fields: Fields) -> Message:
    """Return the message of our type that the fields of another are; raises MessageError if one is missing or wrong."""
    try:
        return CONVERSIONS[type_name][1](fields)
    except KeyError as error:
        raise MessageError(f"{type_name}: expected a field {error.args[0]!s:.80}, found none") from None
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise MessageError(f"{type_name}: expected the fields of this type, found others") from None
