"""Recorded sessions in one log and in several, as `record --split` and other recorders write them."""

from collections.abc import Sequence
from pathlib import Path

from mcap.writer import Writer

from recorders.cdr.rosbags_types import schema_text
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import PART, part_path
from recorders.reading.reader import LogReader
from recorders.writing.writer import RESERVED, LogWriter

SESSION = "0123456789abcdef0123456789abcdef"


def split(log: Path, out: Path, at: Sequence[int], *, numbered: bool = True) -> list[Path]:
    """Write a log once more, in parts that begin at these messages, as the recorder would have."""
    reader = LogReader(log)
    records, bounds = list(reader), [0, *at]
    manifest = {key: value for key, value in reader.manifest.items() if key not in RESERVED}
    attachments = {name: reader.attachment(name) for name in reader.attachments}
    paths = [part_path(out, number) for number in range(len(bounds))]
    for number, (path, begin, end) in enumerate(zip(paths, bounds, [*bounds[1:], len(records)], strict=True)):
        part = {PART: {"session": SESSION, "number": number, "more": end < len(records)}} if numbered else {}
        with LogWriter(path, manifest={**manifest, **part}, attachments=attachments) as writer:
            for record in records[begin:end]:
                writer.copy(record)
    return paths


def write_foreign(path: Path, records: Sequence[RecordedMessage]) -> Path:
    """Write messages as another program does, by the library; a topic without a type has no schema."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for record in records:
            if record.topic not in channels:
                kind = record.type
                schema = writer.register_schema(kind, "ros2msg", schema_text(kind).encode()) if kind else 0
                channels[record.topic] = writer.register_channel(record.topic, "cdr", schema)
            time_ns = record.log_time_ns
            writer.add_message(channels[record.topic], time_ns, record.data, time_ns, record.sequence)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
