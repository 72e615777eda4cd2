"""Finding the next whole record behind damage: only what its own CRC or checksum proves counts as found."""

import re
from collections.abc import Callable, Iterator
from io import SEEK_SET
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Metadata

from recorders.errors import LogError
from recorders.mcap_format.attachments import check_attachment
from recorders.mcap_format.chunk_contents import checked
from recorders.mcap_format.crc_coverage import carries_crc
from recorders.mcap_format.manifest import METADATA_NAME, from_metadata
from recorders.mcap_format.records import CRC, RawRecord, parse

_WINDOW = 2**20  # bytes searched at a time
_LONGEST = 64  # bytes that a pattern needs to be recognised

# No length reaches 2^40, so its upper bytes are 0; a chunk names one of three compressions.
_HEADS = re.compile(
    rb"(?=\x06.{5}\0{3}.{28}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)"
    rb"|\x09.{5}\0{3}"
    rb"|\x0c.{5}\0{3}" + CRC.pack(len(METADATA_NAME)) + METADATA_NAME.encode() + rb")",
    re.DOTALL,
)


def find_proven(file: BinaryIO, start: int, end: int, read: Callable[[int], RawRecord]) -> int | None:
    """Return where the first record that proves itself stands in [start, end), None if there is none.

    Parameters
    ----------
    file : file
        A log; its place is changed.
    start, end : int
        Where to search [bytes].
    read : callable
        Reads the record at an offset; raises LogError if it is not whole.
    """
    for offset in _candidates(file, start, end):
        try:
            record = read(offset)
        except LogError:
            continue
        if proves_itself(record):
            return offset
    return None


def proves_itself(record: RawRecord) -> bool:
    """Whether a CRC or checksum of its own shows that a record is as it was written."""
    try:
        match record.opcode:
            case Opcode.CHUNK:
                return carries_crc(record) and checked(record) is not None
            case Opcode.ATTACHMENT:
                return check_attachment(record)
            case Opcode.METADATA:
                return bool(from_metadata(parse(Metadata, record).metadata))
    except LogError:
        pass
    return False


def _candidates(file: BinaryIO, start: int, end: int) -> Iterator[int]:
    """Yield the places in [start, end) where the head of such a record may stand."""
    for place in range(start, end, _WINDOW):
        file.seek(place, SEEK_SET)
        window = file.read(min(_WINDOW, end - place) + _LONGEST)
        for match in _HEADS.finditer(window):
            if match.start() < min(_WINDOW, end - place):
                yield place + match.start()
