"""geometry_msgs/msg/TransformStamped."""

from collections.abc import Iterator

from recorders.cdr.message_format import HEADER_PARTS, MessageFormat, Value, components, header_fields, write_header
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.message_types import TransformStamped


def read_transform(reader: CdrReader) -> TransformStamped:
    """Read one transform, of its own or of several."""
    stamp_ns, frame_id, child_frame_id = reader.time_ns(), reader.string(), reader.string()
    return TransformStamped(stamp_ns, frame_id, child_frame_id, reader.float64s(3), reader.float64s(4))


def write_transform(writer: CdrWriter, message: TransformStamped) -> None:
    """Write one transform, of its own or of several."""
    write_header(writer, message.stamp_ns, message.frame_id)
    writer.string(message.child_frame_id)
    writer.float64s(message.translation)
    writer.float64s(message.rotation)


def transform_fields(message: TransformStamped, prefix: str = "") -> Iterator[tuple[str, Value]]:
    """Yield the fields of one transform, of its own or of several."""
    yield from header_fields(message, prefix)
    yield f"{prefix}child_frame_id", message.child_frame_id
    yield from components(f"{prefix}transform.translation", "xyz", message.translation)
    yield from components(f"{prefix}transform.rotation", "xyzw", message.rotation)


TRANSFORM_PARTS = (*HEADER_PARTS, "child_frame_id", "transform.translation", "transform.rotation")

FORMAT = MessageFormat(TransformStamped, read_transform, write_transform, transform_fields, TRANSFORM_PARTS)
