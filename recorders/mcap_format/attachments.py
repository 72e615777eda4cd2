"""Attachments of a log: their data may be longer than the memory, so they are checked and copied in pieces."""

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from recorders.mcap_format.errors import damaged
from recorders.mcap_format.records import CRC, RawRecord

_TIMES = struct.Struct("<QQ")  # log time, time of creation [ns]
_STRING = struct.Struct("<I")
_DATA = struct.Struct("<Q")


class AttachmentHead(NamedTuple):
    """The fields before the data of an attachment.

    Attributes
    ----------
    log_time_ns, create_time_ns : int
        When it was recorded and made [ns].
    name, media_type : str
        What it is called, and what it is.
    start, size : int
        Where the data begin in the body of the record, and how long they are [bytes].
    """

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    start: int
    size: int

    @property
    def end(self) -> int:
        """End of the data, where the CRC follows [bytes]."""
        return self.start + self.size


def attachment_head(record: RawRecord) -> AttachmentHead:
    """Return what comes before the data of an attachment; raises DamagedLog if it is malformed."""
    body = record.body
    try:
        log_time_ns, create_time_ns = _TIMES.unpack_from(body)
        name, position = _text(body, _TIMES.size)
        media_type, position = _text(body, position)
        (size,) = _DATA.unpack_from(body, position)
    except (struct.error, ValueError):
        raise damaged(record.offset, "an attachment is malformed") from None
    head = AttachmentHead(log_time_ns, create_time_ns, name, media_type, position + _DATA.size, size)
    if head.end + CRC.size > record.size:
        raise damaged(record.offset, "an attachment is not as long as it states")
    return head


def attachment_has_crc(record: RawRecord) -> bool:
    """Whether an attachment has a CRC of its own: 0 means none. Raises DamagedLog if it is malformed."""
    return record.part(attachment_head(record).end, CRC.size) != bytes(CRC.size)


def check_attachment(record: RawRecord) -> bool:
    """Return whether an attachment has a CRC of its own; raises DamagedLog if that does not hold."""
    end, crc = attachment_head(record).end, 0
    expected = record.part(end, CRC.size)
    if expected == bytes(CRC.size):
        return False
    for piece in _pieces(record, 0, end):
        crc = zlib.crc32(piece, crc)
    if expected != CRC.pack(crc):
        raise damaged(record.offset, "the CRC of an attachment does not hold")
    return True


def attachment_data(record: RawRecord) -> Iterator[memoryview]:
    """Yield the data of an attachment piece by piece; raises DamagedLog if it is malformed."""
    head = attachment_head(record)
    return _pieces(record, head.start, head.end)


def _text(body: bytes, position: int) -> tuple[str, int]:
    """Return the text at a position, and where the next field stands."""
    (length,) = _STRING.unpack_from(body, position)
    position += _STRING.size
    return str(body[position : position + length], "utf-8"), position + length


def _pieces(record: RawRecord, start: int, end: int) -> Iterator[memoryview]:
    """Yield the body of a record from `start` to `end` piece by piece."""
    position = 0
    for piece in record.pieces():
        yield memoryview(piece)[max(0, start - position) : max(0, end - position)]
        position += len(piece)
