"""Logs that claim, hold or declare more than a memory has room for, made record by record."""

import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import lz4.frame
import zstandard

MAGIC = b"\x89MCAP0\r\n"
COMPRESS = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress}
_PIECE = bytes(2**20)


def record(opcode: int, body: bytes) -> bytes:
    """Return a record."""
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: str) -> bytes:
    """Return a text with its length before it."""
    return struct.pack("<I", len(value.encode())) + value.encode()


def channel(number: int, topic: str, *, encoding: str = "raw") -> bytes:
    """Return the declaration of a channel without a schema."""
    return record(4, struct.pack("<HH", number, 0) + text(topic) + text(encoding) + struct.pack("<I", 0))


def message(number: int, data: bytes, *, sequence: int = 0, time_ns: int = 0) -> bytes:
    """Return a message."""
    return record(5, struct.pack("<HIQQ", number, sequence, time_ns, time_ns) + data)


def chunk(data: bytes, compression: str = "zstd", *, size: int | None = None, stored: bytes | None = None) -> bytes:
    """Return a chunk that holds some data, or claims another size or holds what was compressed otherwise."""
    stored = COMPRESS[compression](data) if stored is None else stored
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data)) + text(compression)
    return record(6, head + struct.pack("<Q", len(stored)) + stored)


def zeros_crc(size: int, crc: int = 0) -> int:
    """Return the CRC of so many zeros behind something."""
    for start in range(0, size, len(_PIECE)):
        crc = zlib.crc32(memoryview(_PIECE)[: size - start], crc)
    return crc


def log(path: Path, records: Iterable[bytes | int]) -> Path:
    """Write a log without a summary; a number among the records is so many zeros [bytes], as a hole of the file."""
    with path.open("wb") as file:
        file.write(MAGIC + record(1, text("") + text("hostile")))
        crc = zlib.crc32(MAGIC + record(1, text("") + text("hostile")))
        for each in records:
            if isinstance(each, int):
                file.seek(each, 1)
                crc = zeros_crc(each, crc)
            else:
                file.write(each)
                crc = zlib.crc32(each, crc)
        file.write(record(15, struct.pack("<I", crc)) + record(2, bytes(20)) + MAGIC)
    return path


def attachment(name: str, size: int) -> Iterator[bytes | int]:
    """Yield an attachment of zeros, with its CRC."""
    fields = bytes(16) + text(name) + text("") + struct.pack("<Q", size)
    yield struct.pack("<BQ", 9, len(fields) + size + 4) + fields
    yield size
    yield struct.pack("<I", zeros_crc(size, zlib.crc32(fields)))


def bare_message(number: int, size: int, *, sequence: int = 0, time_ns: int = 0) -> Iterator[bytes | int]:
    """Yield a message of zeros, beside the chunks."""
    yield struct.pack("<BQHIQQ", 5, 22 + size, number, sequence, time_ns, time_ns)
    yield size


def small(number: int = 1, count: int = 3) -> bytes:
    """Return a sound chunk: a channel and a few messages."""
    body = channel(number, f"/sound/{number}")
    return chunk(body + b"".join(message(number, b"sound", sequence=i, time_ns=i) for i in range(count)))


def zeros(size: int, compression: str) -> bytes:
    """Return so many zeros compressed, made in little memory."""
    made = (
        zstandard.ZstdCompressor().compressobj(size=size) if compression == "zstd" else lz4.frame.LZ4FrameCompressor()
    )
    begin = [made.begin(size)] if isinstance(made, lz4.frame.LZ4FrameCompressor) else []
    pieces = (_PIECE[: size - start] for start in range(0, size, len(_PIECE)))
    return b"".join([*begin, *map(made.compress, pieces), made.flush()])
