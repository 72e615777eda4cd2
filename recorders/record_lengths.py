"""The length of a large record, checked against what its body says of itself before memory is taken for it."""

import struct
from io import SEEK_SET
from typing import BinaryIO

from mcap.opcode import Opcode

from recorders.damage import cut_off, damaged

LARGE = 2**24  # bytes: a record of this length is checked before it is read
MAX_CHUNK = 2**30  # bytes, uncompressed: writers make chunks of some MB, a damaged length field may say anything

_MOST = 2**28  # bytes of any other record but an attachment: no message of a robot is as long
_MOST_BEHIND = 2**20  # bytes of fields that nobody knows yet: more of them are no fields
_STRING = struct.Struct("<I")
_DATA = struct.Struct("<Q")
_LAYOUTS: dict[int, tuple[int, int, int]] = {  # bytes before the texts, number of texts, bytes behind the data
    Opcode.CHUNK: (28, 1, 0),
    Opcode.ATTACHMENT: (16, 2, 4),
}


def check_length(file: BinaryIO, opcode: int, length: int, offset: int) -> None:
    """Check the length of the record at `offset`; the file, whose place is behind the record's head, stays there.

    Raises
    ------
    DamagedLog
        If the fields of the body are longer or far shorter, or no record of this kind is as long.
    """
    layout = _LAYOUTS.get(opcode)
    if layout is not None and not 0 <= length - _length_by_fields(file, offset, *layout) <= _MOST_BEHIND:
        raise damaged(offset, f"a record of kind {opcode} is not as long as it says")
    most = MAX_CHUNK if opcode == Opcode.CHUNK else _MOST
    if opcode != Opcode.ATTACHMENT and length > most:
        raise damaged(offset, f"a record of kind {opcode} claims {length} bytes, and {most} is the most")


def _length_by_fields(file: BinaryIO, offset: int, fixed: int, texts: int, behind: int) -> int:
    begin = file.tell()
    place = begin + fixed
    try:
        for _ in range(texts):
            file.seek(place, SEEK_SET)
            place += _STRING.size + _STRING.unpack(file.read(_STRING.size))[0]
        file.seek(place, SEEK_SET)
        (data_length,) = _DATA.unpack(file.read(_DATA.size))
    except struct.error:
        raise cut_off(offset) from None
    file.seek(begin, SEEK_SET)
    return place - begin + _DATA.size + int(data_length) + behind
