"""An attachment is copied to the byte; where that fails, the error names the one of the two files that failed."""

import io
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from recorders.errors import LogError
from recorders.mcap_format.records import RawRecord
from recorders.mcap_format.unread import Unread
from recorders.reading.reader import LogReader
from recorders.writing.attachment_copy import copy_attachment
from recorders.writing.mcap_writer import McapWriter
from recorders.writing.writer import LogWriter

DATA = bytes(range(256)) * 64


@pytest.fixture
def log(tmp_path: Path) -> LogReader:
    LogWriter(tmp_path / "log.mcap", manifest={}, attachments={"a.bin": DATA}).close()
    return LogReader(tmp_path / "log.mcap")


def test_a_copy_is_the_same_to_the_byte(log: LogReader) -> None:
    writer = McapWriter(file := io.BytesIO())
    with log.attachment_records() as records:
        assert [copy_attachment(record, writer) for record in records] == [None]
    writer.finish()
    file.seek(0)
    (found,) = make_reader(file).iter_attachments()
    assert (found.name, found.data) == ("a.bin", DATA)


def test_why_a_copy_cannot_be_written_is_given_back(log: LogReader) -> None:
    full = Path("/dev/full").open("wb")  # noqa: SIM115  # what waits to be written fails once more where it is closed
    writer = McapWriter(full)
    with log.attachment_records() as records:
        failures = [copy_attachment(record, writer) for record in records]
    assert [type(failure) for failure in failures] == [OSError]
    with pytest.raises(OSError, match="No space left on device"):
        full.close()


def test_a_log_that_cannot_be_read_is_named_as_that() -> None:
    head = bytes(16) + bytes(8) + (100).to_bytes(8, "little")
    with Path("/proc/self/mem").open("rb", buffering=0) as unreadable:
        record = RawRecord(Opcode.ATTACHMENT, 0, head, Unread(unreadable, 0, 104))
        with pytest.raises(LogError, match=r"^cannot be read: Input/output error$"):
            copy_attachment(record, McapWriter(io.BytesIO()))
