"""std_msgs/msg/Float64MultiArray."""

from collections.abc import Iterator

from recorders.cdr.message_format import MessageFormat, Value
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.message_types import Dimension, Float64MultiArray


def _read(reader: CdrReader) -> Float64MultiArray:
    dims = tuple(Dimension(reader.string(), reader.uint32(), reader.uint32()) for _ in range(reader.uint32()))
    data_offset = reader.uint32()
    return Float64MultiArray(reader.float64s(reader.uint32()), dims=dims, data_offset=data_offset)


def _write(writer: CdrWriter, message: Float64MultiArray) -> None:
    writer.uint32(len(message.dims))
    for dimension in message.dims:
        writer.string(dimension.label)
        writer.uint32(dimension.size)
        writer.uint32(dimension.stride)
    writer.uint32(message.data_offset)
    writer.uint32(len(message.data))
    writer.float64s(message.data)


def _fields(message: Float64MultiArray) -> Iterator[tuple[str, Value]]:
    for place, dimension in enumerate(message.dims):
        for part, value in dimension._asdict().items():
            yield f"layout.dim[{place}].{part}", value
    yield "layout.data_offset", message.data_offset
    for place, number in enumerate(message.data.tolist()):
        yield f"data[{place}]", number


_PARTS = ("layout.dim.label", "layout.dim.size", "layout.dim.stride", "layout.data_offset", "data")

FORMAT = MessageFormat(Float64MultiArray, _read, _write, _fields, _PARTS)
