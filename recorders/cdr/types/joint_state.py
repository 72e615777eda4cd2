"""sensor_msgs/msg/JointState."""

from collections.abc import Iterator

from recorders.cdr.message_format import HEADER_PARTS, MessageFormat, Value, header_fields, write_header
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.message_types import JointState


def _read(reader: CdrReader) -> JointState:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    name = tuple(reader.string() for _ in range(reader.uint32()))
    position, velocity, effort = (reader.float64s(reader.uint32()) for _ in range(3))
    return JointState(stamp_ns, name, position, velocity=velocity, effort=effort, frame_id=frame_id)


def _write(writer: CdrWriter, message: JointState) -> None:
    write_header(writer, message.stamp_ns, message.frame_id)
    writer.uint32(len(message.name))
    for name in message.name:
        writer.string(name)
    for values in (message.position, message.velocity, message.effort):
        writer.uint32(len(values))
        writer.float64s(values)


def _fields(message: JointState) -> Iterator[tuple[str, Value]]:
    yield from header_fields(message)
    for place, name in enumerate(message.name):
        yield f"name[{place}]", name
    for part in ("position", "velocity", "effort"):
        values: list[float] = getattr(message, part).tolist()
        for place, (value, name) in enumerate(zip(values, message.name, strict=False)):  # a part may be empty
            yield f"{part}[{place}] ({name})", value


FORMAT = MessageFormat(JointState, _read, _write, _fields, (*HEADER_PARTS, "name", "position", "velocity", "effort"))
