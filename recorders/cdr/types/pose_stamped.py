"""geometry_msgs/msg/PoseStamped."""

from collections.abc import Iterator

from recorders.cdr.message_format import HEADER_PARTS, MessageFormat, Value, components, header_fields, write_header
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.message_types import PoseStamped


def _read(reader: CdrReader) -> PoseStamped:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    return PoseStamped(stamp_ns, reader.float64s(3), orientation=reader.float64s(4), frame_id=frame_id)


def _write(writer: CdrWriter, message: PoseStamped) -> None:
    write_header(writer, message.stamp_ns, message.frame_id)
    writer.float64s(message.position)
    writer.float64s(message.orientation)


def _fields(message: PoseStamped) -> Iterator[tuple[str, Value]]:
    yield from header_fields(message)
    yield from components("pose.position", "xyz", message.position)
    yield from components("pose.orientation", "xyzw", message.orientation)


FORMAT = MessageFormat(PoseStamped, _read, _write, _fields, (*HEADER_PARTS, "pose.position", "pose.orientation"))
