"""A message type as somebody else brings it: geometry_msgs/msg/PointStamped."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from recorders.cdr.message_format import HEADER_PARTS, MessageFormat, Value, components, header_fields, write_header
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.validation import FloatArray, stamp, store, text, vector


@dataclass(frozen=True, slots=True, eq=False)
class PointStamped:
    TYPE: ClassVar[str] = "geometry_msgs/msg/PointStamped"
    stamp_ns: int
    point: FloatArray
    frame_id: str = "world"

    def __post_init__(self) -> None:
        store(self, "stamp_ns", stamp(self, "stamp_ns", self.stamp_ns))
        store(self, "point", vector(self, "point", self.point, 3))
        text(self, "frame_id", self.frame_id)


def _read(reader: CdrReader) -> PointStamped:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    return PointStamped(stamp_ns, reader.float64s(3), frame_id)


def _write(writer: CdrWriter, message: PointStamped) -> None:
    write_header(writer, message.stamp_ns, message.frame_id)
    writer.float64s(message.point)


def _fields(message: PointStamped) -> Iterator[tuple[str, Value]]:
    yield from header_fields(message)
    yield from components("point", "xyz", message.point)


FORMAT = MessageFormat(PointStamped, _read, _write, _fields, (*HEADER_PARTS, "point"))
