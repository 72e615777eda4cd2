"""Where the sections of an MCAP file are, and what its CRCs cover."""

import zlib
from collections.abc import Iterator
from io import SEEK_END
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Footer

from recorders.damage import DamagedLog, cut_off, damaged
from recorders.mcap_records import FOOTER_SIZE, MAGIC, Record, check_crc, parse, read_record

_DATA_END_SIZE = 13  # opcode, length, CRC
_PIECE = 2**20  # bytes


def read_footer(file: BinaryIO) -> Footer:
    """Return the footer; raises DamagedLog if the file is cut off, or the footer points past its own place."""
    size = file.seek(0, SEEK_END)
    end = size - FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        raise cut_off(size)
    file.seek(end)
    try:
        record = read_record(file, size)
    except DamagedLog:
        raise cut_off(size) from None
    if record.opcode != Opcode.FOOTER or file.read() != MAGIC:
        raise cut_off(size)
    footer: Footer = parse(Footer, record)
    if footer.summary_start > end:
        raise damaged(end, "its footer points past its end")
    return footer


def read_data_end(file: BinaryIO) -> Record:
    """Return the record that ends the data section; raises DamagedLog if the file is cut off or has none there."""
    size = file.seek(0, SEEK_END)
    start = read_footer(file).summary_start or size - FOOTER_SIZE - len(MAGIC)
    return record_at(file, max(0, start - _DATA_END_SIZE), Opcode.DATA_END)


def record_at(file: BinaryIO, offset: int, opcode: Opcode) -> Record:
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
    """Check the CRC over the whole data section, in one pass that leaves the file's place as it was.

    A file that is cut off, or has no such CRC, passes.

    Raises
    ------
    DamagedLog
        If the CRC does not hold.
    """
    place = file.tell()
    try:
        end = read_data_end(file)
    except DamagedLog as error:
        if error.reason:
            raise
    else:
        crc = 0
        for piece in _pieces(file, end.offset):
            crc = zlib.crc32(piece, crc)
        check_crc(end.body, crc, end.offset, "data section")
    file.seek(place)


def _pieces(file: BinaryIO, end: int) -> Iterator[bytes]:
    file.seek(0)
    for start in range(0, end, _PIECE):
        yield file.read(min(_PIECE, end - start))
