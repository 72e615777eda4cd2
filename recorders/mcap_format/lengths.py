"""Limits on the memory a log may take and on how much of a large record is read; no length field is trusted.

Reading a log takes less than 256 MB, whatever it claims, beside a message outside of the chunks that somebody asks for:
the program takes 40, and three times the longest chunk fit besides, as stored, as it comes out, and as a message of it.
"""

import struct
from io import SEEK_SET
from typing import BinaryIO

from mcap.opcode import Opcode

from recorders.mcap_format.errors import TooLarge, cut_off, damaged

MAX_CHUNK = 70_000_000  # bytes, uncompressed or as stored: writers make chunks of some MB
LARGE = 2**24  # bytes: a record of this length is checked before it is read, and read in part where that is enough

MAX_DECLARED = 20_000_000  # bytes of all schemas and channels, which are held as long as a log is read
MAX_CHANNEL = 2**20  # bytes of one channel: its metadata take twenty times the memory

_BEGINNING = 2**16  # bytes
_MOST_BEHIND = 2**20  # bytes of fields that nobody knows yet (more are no fields), or that a compression adds
_STRING = struct.Struct("<I")
_DATA = struct.Struct("<Q")
_LAYOUTS: dict[int, tuple[int, int, int]] = {  # bytes before the texts, number of texts, bytes behind the data
    Opcode.CHUNK: (28, 1, 0),
    Opcode.ATTACHMENT: (16, 2, 4),
}
_EXPANDED = 2_000_000_000  # bytes that may come out of all chunks of a log, however short it is
_EXPANSION = 255  # bytes that may come out for each byte of a longer one: as much as lz4 can hold
_BOUNDED = frozenset(  # records that are needed whole, and that no writer makes as long
    {
        0,
        Opcode.HEADER,
        Opcode.FOOTER,
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.STATISTICS,
        Opcode.METADATA,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
        Opcode.DATA_END,
    }
)


class Expansion:
    """How much may come out of the chunks of a log: a short one would keep a processor busy for hours.

    Parameters
    ----------
    size : int
        Of the file [bytes].
    """

    def __init__(self, size: int) -> None:
        self._most = self._room = max(_EXPANDED, _EXPANSION * size)

    def take(self, offset: int, size: int) -> None:
        """Take in that the chunk at `offset` holds `size` bytes; raises TooLarge if all are too much."""
        if size > MAX_CHUNK:
            return  # refused by itself
        if size > self._room:
            raise TooLarge(offset, f"what came out of the chunks before is all of the {self._most} bytes that are read")
        self._room -= size


def length_to_read(file: BinaryIO, opcode: int, length: int, offset: int) -> int:
    """Return how much of the body of the large record at `offset` is to be read [bytes].

    That is all of a chunk that is not too large, and the beginning of any other: an attachment up to its data, of
    which most readers want no more. The file, whose position is behind the record's head, stays there.

    Raises
    ------
    DamagedLog
        If the fields of the body are longer or far shorter, or no record of this kind is as long.
    """
    layout = _LAYOUTS.get(opcode)
    if opcode in _BOUNDED:
        raise damaged(offset, f"a record of kind {opcode} claims {length} bytes, and {LARGE} is the most")
    if layout is None:
        return _BEGINNING
    fixed, texts, behind = layout
    begin, data_length = _data(file, offset, fixed, texts)
    if not 0 <= length - begin - data_length - behind <= _MOST_BEHIND:
        raise damaged(offset, f"a record of kind {opcode} is not as long as it states")
    if opcode == Opcode.CHUNK and length <= MAX_CHUNK + _MOST_BEHIND:
        return length
    if begin > LARGE:
        raise damaged(offset, f"the texts of a record of kind {opcode} have {begin} bytes, and {LARGE} is the most")
    return begin


def _data(file: BinaryIO, offset: int, fixed: int, texts: int) -> tuple[int, int]:
    """Return where the data begin in the body of the record at `offset`, and how long they are [bytes]."""
    begin = file.tell()
    position = begin + fixed
    try:
        for _ in range(texts):
            file.seek(position, SEEK_SET)
            position += _STRING.size + _STRING.unpack(file.read(_STRING.size))[0]
        file.seek(position, SEEK_SET)
        (data_length,) = _DATA.unpack(file.read(_DATA.size))
    except struct.error:
        raise cut_off(offset) from None
    file.seek(begin, SEEK_SET)
    return position - begin + _DATA.size, int(data_length)
