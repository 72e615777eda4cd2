"""The message types field by field: how each is read from plain CDR and written to it.

This is the general codec, which takes either byte order; `recorders.cdr.codec` puts byte templates in front of it.
"""

from collections.abc import Callable

from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.errors import MessageError
from recorders.messages.message_types import (
    Clock,
    Dimension,
    Float64MultiArray,
    JointState,
    Message,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)


def read_message(type_name: str, data: bytes) -> Message:
    """Decode one message of any type of `recorders.messages.message_types`.

    Raises
    ------
    MessageError
        If the type is unknown or the bytes are not a message of it.
    """
    read = _READERS.get(type_name)
    if read is None:
        raise MessageError(f"expected one of {', '.join(_READERS)}, found {type_name!r}")
    try:
        reader = CdrReader(data)
        message = read(reader)
        reader.finish()
    except MessageError as error:
        raise MessageError(f"{type_name}: {error}") from None
    return message


def write_message(message: Message) -> CdrWriter:
    """Encode one message as little-endian CDR; the writer holds the payload and where its floats are."""
    writer = CdrWriter()
    match message:
        case JointState():
            _write_joint_state(writer, message)
        case PoseStamped():
            _write_header(writer, message.stamp_ns, message.frame_id)
            writer.float64s(message.position)
            writer.float64s(message.orientation)
        case String():
            writer.string(message.data)
        case Float64MultiArray():
            _write_multi_array(writer, message)
        case TransformStamped():
            _write_transform(writer, message)
        case TFMessage():
            writer.uint32(len(message.transforms))
            for transform in message.transforms:
                _write_transform(writer, transform)
        case Clock():
            writer.time_ns(message.clock_ns)
    return writer


def _write_header(writer: CdrWriter, stamp_ns: int, frame_id: str) -> None:
    writer.time_ns(stamp_ns)
    writer.string(frame_id)


def _write_joint_state(writer: CdrWriter, message: JointState) -> None:
    _write_header(writer, message.stamp_ns, message.frame_id)
    writer.uint32(len(message.name))
    for name in message.name:
        writer.string(name)
    for values in (message.position, message.velocity, message.effort):
        writer.uint32(len(values))
        writer.float64s(values)


def _write_multi_array(writer: CdrWriter, message: Float64MultiArray) -> None:
    writer.uint32(len(message.dims))
    for dimension in message.dims:
        writer.string(dimension.label)
        writer.uint32(dimension.size)
        writer.uint32(dimension.stride)
    writer.uint32(message.data_offset)
    writer.uint32(len(message.data))
    writer.float64s(message.data)


def _write_transform(writer: CdrWriter, message: TransformStamped) -> None:
    _write_header(writer, message.stamp_ns, message.frame_id)
    writer.string(message.child_frame_id)
    writer.float64s(message.translation)
    writer.float64s(message.rotation)


def _read_joint_state(reader: CdrReader) -> JointState:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    name = tuple(reader.string() for _ in range(reader.uint32()))
    position, velocity, effort = (reader.float64s(reader.uint32()) for _ in range(3))
    return JointState(stamp_ns, name, position, velocity=velocity, effort=effort, frame_id=frame_id)


def _read_pose(reader: CdrReader) -> PoseStamped:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    return PoseStamped(stamp_ns, reader.float64s(3), orientation=reader.float64s(4), frame_id=frame_id)


def _read_multi_array(reader: CdrReader) -> Float64MultiArray:
    dims = tuple(Dimension(reader.string(), reader.uint32(), reader.uint32()) for _ in range(reader.uint32()))
    data_offset = reader.uint32()
    return Float64MultiArray(reader.float64s(reader.uint32()), dims=dims, data_offset=data_offset)


def _read_transform(reader: CdrReader) -> TransformStamped:
    stamp_ns, frame_id, child_frame_id = reader.time_ns(), reader.string(), reader.string()
    return TransformStamped(stamp_ns, frame_id, child_frame_id, reader.float64s(3), reader.float64s(4))


def _read_transforms(reader: CdrReader) -> TFMessage:
    return TFMessage(tuple(_read_transform(reader) for _ in range(reader.uint32())))


_READERS: dict[str, Callable[[CdrReader], Message]] = {
    JointState.TYPE: _read_joint_state,
    PoseStamped.TYPE: _read_pose,
    String.TYPE: lambda reader: String(reader.string()),
    Float64MultiArray.TYPE: _read_multi_array,
    TransformStamped.TYPE: _read_transform,
    TFMessage.TYPE: _read_transforms,
    Clock.TYPE: lambda reader: Clock(reader.time_ns()),
}
