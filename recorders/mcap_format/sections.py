"""Offsets of the sections of an MCAP file, and the bytes that its CRCs cover."""

import zlib
from collections.abc import Iterator
from io import SEEK_END
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Footer

from recorders.mcap_format.errors import DamagedLog, cut_off, damaged
from recorders.mcap_format.records import CRC, FOOTER_SIZE, HEAD, MAGIC, RawRecord, check_crc, parse, read_record

_DATA_END_SIZE = 13  # opcode, length, CRC
_BODY_BEGINS = 24  # bytes of a body that come with its head: the times of chunks and messages are among them
_WINDOW = 2**14  # bytes in which heads are looked for without reading once more: messages may stand one by one
_PIECE = 2**20  # bytes


class Head(NamedTuple):
    """Opcode of a record, its beginning and end in the file [bytes], and the first 24 bytes of its body."""

    opcode: int
    offset: int
    end: int
    begins: bytes


def heads(file: BinaryIO, start: int, end: int) -> Iterator[Head]:
    """Yield the heads of the records in [start, end) for as long as they are whole; their bodies are not read."""
    window, begin, unpack, size = b"", start, HEAD.unpack_from, HEAD.size
    while end - start >= size:
        position = start - begin
        if position + size + _BODY_BEGINS > len(window):
            file.seek(start)
            window, begin, position = file.read(_WINDOW), start, 0
            if len(window) < size:  # the file became shorter
                return
        opcode, length = unpack(window, position)
        body = position + size
        following = start + size + length
        if opcode == 0 or following > end:
            return
        yield Head(opcode, start, following, window[body : body + min(length, _BODY_BEGINS)])
        start = following


def read_footer(file: BinaryIO) -> Footer:
    """Return the footer; raises DamagedLog if the file is cut off, or the footer points past its own position."""
    record = footer_record(file)
    footer: Footer = parse(Footer, record)
    if footer.summary_start > record.offset:
        raise damaged(record.offset, "its footer points past its end")
    return footer


def footer_record(file: BinaryIO) -> RawRecord:
    """Return the record that the footer is; raises DamagedLog if the file is cut off."""
    size = file.seek(0, SEEK_END)
    end = size - len(MAGIC)
    file.seek(max(0, end))
    if end < len(MAGIC) + FOOTER_SIZE or file.read() != MAGIC:
        raise cut_off(whole_until(file, size))
    position = _found(file, Opcode.FOOTER, end - FOOTER_SIZE, end)
    if position is None:
        raise cut_off(whole_until(file, size))
    return record_at(file, position, Opcode.FOOTER)


def whole_until(file: BinaryIO, size: int, start: int = len(MAGIC)) -> int:
    """Return where the first record begins that is not whole, in a file of `size` bytes: its end if there is none.

    That is where a log is cut off, for whoever reads it record by record too; all from `start` on are looked at.
    """
    end = min(start, size)
    for head in heads(file, end, size):
        if head.opcode == Opcode.FOOTER:
            return size
        end = head.end
    return end


def find_data_end(file: BinaryIO, end: int) -> int | None:
    """Return where the record begins that ends the data section, and ends itself at `end`; None if none does."""
    return _found(file, Opcode.DATA_END, end - _DATA_END_SIZE, end)


def _found(file: BinaryIO, opcode: Opcode, usually: int, end: int) -> int | None:
    """Return where a record of a kind begins that ends at `end`.

    It has a usual place. One with fields that nobody knows yet is longer: then only a walk over all records finds it.
    """
    for start in (max(0, usually), len(MAGIC)):
        for head in heads(file, start, end):
            if head.opcode == opcode and head.end == end:
                return head.offset
            if start == usually:
                break
    return None


def read_data_end(file: BinaryIO) -> RawRecord:
    """Return the record that ends the data section; raises DamagedLog if the file is cut off or has none there."""
    footer = footer_record(file)
    end = read_footer(file).summary_start or footer.offset
    position = find_data_end(file, end)
    return record_at(file, max(0, end - _DATA_END_SIZE) if position is None else position, Opcode.DATA_END)


def record_at(file: BinaryIO, offset: int, opcode: Opcode) -> RawRecord:
    """Return the record at `offset`; raises DamagedLog if there is none of this kind."""
    size = file.seek(0, SEEK_END)
    if offset >= size:
        raise cut_off(size)
    file.seek(offset)
    record = read_record(file, size)
    if record.opcode != opcode:
        raise damaged(offset, f"expected a record of kind {int(opcode)}, found {record.opcode}")
    return record


def check_data_section(file: BinaryIO) -> None:
    """Check the CRC over the whole data section, in one pass that leaves the file's position as it was.

    A file that is cut off, or has no such CRC, passes.

    Raises
    ------
    DamagedLog
        If the CRC does not hold.
    """
    position = file.tell()
    try:
        end = read_data_end(file)
    except DamagedLog as error:
        if error.reason:
            raise
    else:
        crc = 0
        for piece in _pieces(file, end.offset):
            crc = zlib.crc32(piece, crc)
        check_crc(end.body[: CRC.size], crc, end.offset, "data section")
    file.seek(position)


def _pieces(file: BinaryIO, end: int) -> Iterator[bytes]:
    file.seek(0)
    for start in range(0, end, _PIECE):
        yield file.read(min(_PIECE, end - start))
