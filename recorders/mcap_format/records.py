"""The frame of an MCAP file: its records one after another, each length and CRC checked before anything is believed.

The library's own readers check only some of the CRCs, and let many kinds of exception through on a damaged file;
here everything that can go wrong ends in one DamagedLog. Record bodies are parsed by the library.
"""

import struct
import zlib
from collections.abc import Iterator, Mapping
from io import SEEK_CUR, BufferedReader, BytesIO
from types import MappingProxyType
from typing import BinaryIO, NamedTuple, Protocol, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode

from recorders.mcap_format.decompression import DECOMPRESS_ERRORS, check_claim, decompress
from recorders.mcap_format.errors import DamagedLog, TooLarge, cut_off, damaged
from recorders.mcap_format.lengths import LARGE, MAX_CHUNK, length_to_read
from recorders.mcap_format.unread import Unread

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 29  # opcode, length, two offsets, CRC
FIRST_RESERVED = 0x10  # kinds from here on are unknown, and to be passed over: later ones of MCAP, and private ones

HEAD = struct.Struct("<BQ")  # opcode, length of the body
CRC = struct.Struct("<I")
INDEX = struct.Struct("<HI")  # of a message index: channel, length of the entries

_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of the entries
_CHUNK = struct.Struct("<QQQII")  # first and last log time, size, CRC, length of the compression's name
_LENGTH = struct.Struct("<Q")
_FOOTER_OFFSETS = 16  # bytes of a footer before its CRC
_PARSE_ERRORS = (McapError, struct.error, ValueError, OverflowError, KeyError)
_DATA_END, _MESSAGE_INDEX = int(Opcode.DATA_END), int(Opcode.MESSAGE_INDEX)  # numbers compare faster than members
_LONGEST_REASON = 100  # characters: some libraries quote all that they were given
_NOWHERE: Mapping[int, int] = MappingProxyType({})
_MISPLACED = frozenset(  # in a data section; 0 is no opcode at all, and what blocks of zeros look like
    {
        0,
        Opcode.HEADER,
        Opcode.FOOTER,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.STATISTICS,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
    }
)


class RawRecord(NamedTuple):
    """One record: what it is, where its first byte stands in the file (or chunk), and its body.

    Of a large one `body` is the beginning, and the `rest` stays in the file.
    """

    opcode: int
    offset: int
    body: bytes
    rest: Unread | None = None

    @property
    def size(self) -> int:
        """Length of the whole body [bytes]."""
        return len(self.body) + (self.rest.size if self.rest else 0)

    @property
    def end(self) -> int:
        """End of the record in the file [bytes]."""
        return self.offset + HEAD.size + self.size

    def pieces(self) -> Iterator[bytes]:
        """Yield the whole body piece by piece; raises DamagedLog if the file became shorter."""
        yield self.body
        if self.rest:
            yield from self.rest.pieces()

    def part(self, start: int, size: int) -> bytes:
        """Return `size` bytes of the body from `start` on; raises DamagedLog if the file became shorter."""
        if self.rest is None:
            return self.body[start : start + size]
        return self.rest.read(self.rest.start - len(self.body) + start, size)


_NOTHING = RawRecord(0, 0, b"")


class ChunkHead(NamedTuple):
    """The fields of a chunk before its data: log times [ns], bytes uncompressed, CRC of those (0: none), compression.

    `start` and `end` are where the data stand in the body of the record.
    """

    first_ns: int
    last_ns: int
    size: int
    crc: int
    compression: str
    start: int
    end: int


_T_co = TypeVar("_T_co", covariant=True)


class Parser(Protocol[_T_co]):
    """A record class of the library."""

    def read(self, stream: ReadDataStream) -> _T_co:
        """Parse a body."""


class _WholeStream(ReadDataStream):
    """The library's stream gives less than was asked for at its end; this one raises."""

    def read(self, length: int) -> bytes:
        """Return the next `length` bytes; raises EndOfFile if there are fewer."""
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def parse(kind: Parser[_T_co], record: RawRecord) -> _T_co:
    """Parse the body of a record; raises DamagedLog if it is malformed."""
    return parse_counted(kind, record)[0]


def parse_counted(kind: Parser[_T_co], record: RawRecord) -> tuple[_T_co, int]:
    """Parse the body of a record, and return how many bytes of it that took; raises DamagedLog if it is malformed."""
    body = BytesIO(record.body)
    try:
        return kind.read(_WholeStream(body)), body.tell()
    except _PARSE_ERRORS as error:
        reason = f"its record of kind {record.opcode} is malformed ({error!s:.{_LONGEST_REASON}})"
        raise damaged(record.offset, reason) from None


def read_record(file: BinaryIO, size: int) -> RawRecord:
    """Read the record at the position of a file of `size` bytes; raises DamagedLog if it is not whole."""
    return _read_at(file, file.tell(), size)


def _read_at(file: BinaryIO, offset: int, size: int) -> RawRecord:
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        raise cut_off(offset)
    opcode, length = HEAD.unpack(head)
    if length > size - offset - HEAD.size:
        raise cut_off(offset)
    wanted = length if length <= LARGE else length_to_read(file, opcode, length, offset)
    body = file.read(wanted)
    if len(body) < wanted:  # the file became shorter while it was read
        raise cut_off(offset)
    if wanted == length:
        return RawRecord(opcode, offset, body)
    start = offset + HEAD.size + wanted
    file.seek(length - wanted, SEEK_CUR)
    return RawRecord(opcode, offset, body, Unread(file, start, length - wanted))


def read_all(file: BinaryIO, size: int, *, skip_ranges: Mapping[int, int] = _NOWHERE) -> Iterator[RawRecord]:
    """Yield the records of a file but its message indexes up to its data end, then check its summary and its end.

    Parameters
    ----------
    file : file
        Open at its first byte.
    size : int
        Its size [bytes].
    skip_ranges : mapping of int to int
        Where to go on, by the offsets of records to leave out. The CRC over the data section cannot be checked then.

    Raises
    ------
    DamagedLog
        If the file is cut off or damaged, after yielding every record before that.
    """
    crc = zlib.crc32(file.read(len(MAGIC)))
    record = read_record(file, size)
    if record.opcode != Opcode.HEADER:
        raise damaged(record.offset, f"expected its header, found a record of kind {record.opcode}")
    while record.opcode != _DATA_END:
        end, crc = record.end, 0 if skip_ranges else crc_of(record, crc)
        if record.opcode != _MESSAGE_INDEX:
            handed, record = [record], _NOTHING
            yield handed.pop()  # whoever takes it may let go of it: there is no room for two large ones
        passed = _pass_indexes(file)
        crc = zlib.crc32(passed, crc)
        record = _next_record(file, end + len(passed), size, skip_ranges)
    check_crc(record.body[: CRC.size], None if skip_ranges else crc, record.offset, "data section")
    yield record
    check_summary(file, size)


def _next_record(file: BinaryIO, offset: int, size: int, skip_ranges: Mapping[int, int]) -> RawRecord:
    while offset in skip_ranges:
        offset = file.seek(skip_ranges[offset])
    record = _read_at(file, offset, size)
    if record.opcode in _MISPLACED:
        raise damaged(offset, f"a record of kind {record.opcode} among its messages")
    if record.opcode == _MESSAGE_INDEX and not is_message_index(record):
        raise damaged(offset, "a message index is not as long as it states")
    return record


def _pass_indexes(file: BinaryIO) -> bytes:
    """Pass over the sound message indexes that stand whole in the file's buffer: there are many, and nobody asks.

    Returns their bytes; what is not sound, or not whole, stays to be read as any other record.
    """
    if not isinstance(file, BufferedReader):
        return b""
    buffer, position = file.peek(), 0
    last = len(buffer) - _INDEX_HEAD.size
    while position <= last:
        opcode, length, _, size = _INDEX_HEAD.unpack_from(buffer, position)
        end = position + HEAD.size + length
        if opcode != _MESSAGE_INDEX or length < INDEX.size + size or end > len(buffer):
            break
        position = end
    return file.read(position)


def is_message_index(record: RawRecord) -> bool:
    """Whether a message index is no shorter than it states."""
    return record.size >= INDEX.size and record.size >= INDEX.size + INDEX.unpack_from(record.body)[1]


def check_summary(file: BinaryIO, size: int) -> None:
    """Check the records from the file's position to the footer, which comes last; raises as `summary_records` does."""
    for _ in summary_records(file, size):
        pass


def summary_records(file: BinaryIO, size: int) -> Iterator[RawRecord]:
    """Yield the records from the file's position to the footer, which comes last, and only then check their CRC.

    Raises
    ------
    DamagedLog
        If one is not whole, the CRC does not hold, or the file does not end behind them.
    """
    crc = 0
    while (record := read_record(file, size)).opcode != Opcode.FOOTER:
        yield record
        crc = crc_of(record, crc)
    offsets, stated = record.body[:_FOOTER_OFFSETS], record.body[_FOOTER_OFFSETS:][: CRC.size]
    if len(stated) < CRC.size:
        raise damaged(record.offset, "its footer is malformed")
    check_crc(stated, zlib.crc32(offsets, zlib.crc32(_head_of(record), crc)), record.offset, "summary")
    if file.read(len(MAGIC)) != MAGIC:
        raise cut_off(size)
    if file.tell() != size:
        raise damaged(file.tell(), "something follows its end")
    yield record


def chunk_head(record: RawRecord) -> ChunkHead:
    """Return the fields of a chunk before its data; raises DamagedLog if they are malformed."""
    try:
        first_ns, last_ns, size, crc, length = _CHUNK.unpack_from(record.body)
        compression = str(record.body[_CHUNK.size : _CHUNK.size + length], "utf-8")
        (data_length,) = _LENGTH.unpack_from(record.body, _CHUNK.size + length)
    except (struct.error, ValueError) as error:
        raise damaged(record.offset, f"a chunk is malformed ({error!s:.{_LONGEST_REASON}})") from None
    start = _CHUNK.size + length + _LENGTH.size
    if record.size - start < data_length:
        raise damaged(record.offset, "a chunk is not as long as it states")
    return ChunkHead(first_ns, last_ns, size, crc, compression, start, start + data_length)


def claimed_size(record: RawRecord) -> int:
    """Return what to expect of a chunk's data, decompressed [bytes]; raises DamagedLog if its claim cannot be true."""
    head = chunk_head(record)
    _check_size(record, head)
    try:
        return check_claim(memoryview(record.body)[head.start : head.end], head.compression, head.size)
    except DECOMPRESS_ERRORS as error:
        raise _undecompressed(record, error) from None


def chunk_data(record: RawRecord, head: ChunkHead | None = None) -> bytes:
    """Return the records inside a chunk, decompressed.

    Parameters
    ----------
    record : RawRecord
        The chunk.
    head : ChunkHead, optional
        Its fields, for whoever has them.

    Raises
    ------
    TooLarge
        If it takes more memory than there is for a chunk.
    DamagedLog
        If the chunk is damaged.
    """
    head = head or chunk_head(record)
    _check_size(record, head)
    try:
        data = decompress(memoryview(record.body)[head.start : head.end], head.compression, head.size)
    except DECOMPRESS_ERRORS as error:
        raise _undecompressed(record, error) from None
    if head.crc not in (0, zlib.crc32(data)):
        raise damaged(record.offset, "the CRC of a chunk does not hold")
    return data


def _check_size(record: RawRecord, head: ChunkHead) -> None:
    if head.size > MAX_CHUNK or record.rest:
        held = f"claims {head.size} bytes, {record.size - head.start} as stored"
        raise TooLarge(record.offset, f"a chunk {held}, and {MAX_CHUNK} is the most that is read at once")


def _undecompressed(record: RawRecord, error: Exception) -> DamagedLog:
    return damaged(record.offset, f"a chunk does not decompress ({error!s:.{_LONGEST_REASON}})")


def check_crc(raw: bytes, found: int | None, offset: int, section: str) -> None:
    """Compare the CRC of a record with what was found (None: nothing to compare); raises DamagedLog."""
    if len(raw) != CRC.size:
        raise damaged(offset, f"the CRC of its {section} is missing")
    (expected,) = CRC.unpack(raw)
    if found is not None and expected not in (0, found):  # 0: the writer made none
        raise damaged(offset, f"the CRC of its {section} does not hold")


def crc_of(record: RawRecord, crc: int) -> int:
    """Return the CRC of what comes before a record, with the record."""
    crc = zlib.crc32(record.body, zlib.crc32(_head_of(record), crc))
    for piece in record.rest.pieces() if record.rest else ():
        crc = zlib.crc32(piece, crc)
    return crc


def _head_of(record: RawRecord) -> bytes:
    return HEAD.pack(record.opcode, record.size)
