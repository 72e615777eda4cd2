"""The frame of an MCAP file: its records one after another, each length and CRC checked before anything is believed.

The library's own readers check only some of the CRCs, and let many kinds of exception through on a damaged file;
here everything that can go wrong ends in one LogError. Record bodies are parsed by the library.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple, Protocol, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk

from recorders.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 29  # opcode, length, two offsets, CRC
MAX_CHUNK = 2**30  # bytes, uncompressed: writers make chunks of some MB, a damaged length field may say anything

_HEAD = struct.Struct("<BQ")  # opcode, length of the body
_CRC = struct.Struct("<I")
_PARSE_ERRORS = (McapError, struct.error, ValueError, OverflowError, KeyError)
_DECOMPRESS_ERRORS = (RuntimeError, ValueError, OverflowError, MemoryError, EOFError, zstandard.ZstdError)


class Record(NamedTuple):
    """One record: what it is, where its first byte stands in the file (or chunk), and its body."""

    opcode: int
    offset: int
    body: bytes


_T_co = TypeVar("_T_co", covariant=True)


class Parser(Protocol[_T_co]):
    """A record class of the library."""

    def read(self, stream: ReadDataStream) -> _T_co:
        """Parse a body."""


def parse(kind: Parser[_T_co], record: Record) -> _T_co:
    """Parse the body of a record; raises LogError if it is malformed."""
    try:
        return kind.read(ReadDataStream(BytesIO(record.body)))
    except _PARSE_ERRORS as error:
        raise damaged(record.offset, f"its record of kind {record.opcode} is malformed ({error!r})") from None


def damaged(offset: int, what: str) -> LogError:
    """Return the error for a log that is not what its writer wrote."""
    return LogError(f"the log is damaged at byte {offset}: {what}; use another copy of it")


def cut_off(offset: int) -> LogError:
    """Return the error for a log that ends too early."""
    return LogError(f"the log is cut off at byte {offset}, before its end was written; use a complete copy of it")


def read_record(file: BinaryIO, size: int) -> Record:
    """Read the record at the file's place; `size` is that of the file [bytes]. Raises LogError if it is not whole."""
    offset = file.tell()
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise cut_off(offset)
    opcode, length = _HEAD.unpack(head)
    if length > size - offset - _HEAD.size:
        raise cut_off(offset)
    return Record(opcode, offset, file.read(length))


def read_all(file: BinaryIO, size: int) -> Iterator[Record]:
    """Yield the records of a file up to its data end, then check its summary section and its end.

    Raises
    ------
    LogError
        If the file is cut off or damaged, after yielding every record before that.
    """
    crc = zlib.crc32(file.read(len(MAGIC)))
    while True:
        record = read_record(file, size)
        if record.opcode == Opcode.DATA_END:
            break
        yield record
        crc = _crc_of(record, crc)
    _check_crc(record.body, crc, record.offset, "data section")
    yield record
    read_summary(file, size)


def read_summary(file: BinaryIO, size: int) -> list[Record]:
    """Return the records from the file's place to the footer, which comes last; raises LogError as `read_all` does."""
    crc = 0
    records = [read_record(file, size)]
    while records[-1].opcode != Opcode.FOOTER:
        crc = _crc_of(records[-1], crc)
        records.append(read_record(file, size))
    footer = records[-1]
    if _HEAD.size + len(footer.body) != FOOTER_SIZE:
        raise damaged(footer.offset, "its footer is malformed")
    crc = zlib.crc32(footer.body[:-4], zlib.crc32(_head_of(footer), crc))
    _check_crc(footer.body[-4:], crc, footer.offset, "summary")
    if file.read(len(MAGIC)) != MAGIC:
        raise cut_off(size)
    return records


def chunk_data(record: Record) -> bytes:
    """Return the records inside a chunk, decompressed; raises LogError if the chunk is damaged."""
    chunk = parse(Chunk, record)
    if chunk.uncompressed_size > MAX_CHUNK:
        raise damaged(record.offset, f"a chunk claims {chunk.uncompressed_size} bytes")
    try:
        data = _decompress(chunk)
    except _DECOMPRESS_ERRORS as error:
        raise damaged(record.offset, f"a chunk does not decompress ({error})") from None
    if len(data) != chunk.uncompressed_size:
        raise damaged(record.offset, f"a chunk holds {len(data)} bytes and claims {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise damaged(record.offset, "the CRC of a chunk does not hold")
    return data


def _decompress(chunk: Any) -> bytes:
    most = chunk.uncompressed_size + 1  # one more than claimed is enough to see that the claim is false
    match chunk.compression:
        case "lz4":
            data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
            return data
        case "zstd":
            return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=most)
        case "":
            return bytes(chunk.data)
    raise ValueError(f"unknown compression {chunk.compression!r}")


def _head_of(record: Record) -> bytes:
    return _HEAD.pack(record.opcode, len(record.body))


def _crc_of(record: Record, crc: int) -> int:
    return zlib.crc32(record.body, zlib.crc32(_head_of(record), crc))


def _check_crc(raw: bytes, found: int, offset: int, section: str) -> None:
    if len(raw) != _CRC.size:
        raise damaged(offset, f"the CRC of its {section} is missing")
    (expected,) = _CRC.unpack(raw)
    if expected not in (0, found):  # 0: the writer made none
        raise damaged(offset, f"the CRC of its {section} does not hold")
