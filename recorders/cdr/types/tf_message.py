"""tf2_msgs/msg/TFMessage."""

from collections.abc import Iterator

from recorders.cdr.message_format import MessageFormat, Value
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.cdr.types.transform_stamped import TRANSFORM_PARTS, read_transform, transform_fields, write_transform
from recorders.messages.message_types import TFMessage


def _read(reader: CdrReader) -> TFMessage:
    return TFMessage(tuple(read_transform(reader) for _ in range(reader.uint32())))


def _write(writer: CdrWriter, message: TFMessage) -> None:
    writer.uint32(len(message.transforms))
    for transform in message.transforms:
        write_transform(writer, transform)


def _fields(message: TFMessage) -> Iterator[tuple[str, Value]]:
    for place, transform in enumerate(message.transforms):
        yield from transform_fields(transform, f"transforms[{place}].")


FORMAT = MessageFormat(TFMessage, _read, _write, _fields, tuple(f"transforms.{part}" for part in TRANSFORM_PARTS))
