"""Decompression that believes no length: what comes out is never longer than what was claimed, nor is the memory."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard

DECOMPRESS_ERRORS = (RuntimeError, ValueError, OverflowError, EOFError, zstandard.ZstdError)
"""Errors that `decompress` raises for damaged data: the libraries have no common error."""

_LZ4_RATIO = 255  # bytes out for a byte in, at the very most: a longer match takes one more byte for every 255
_LZ4_FRAME = 32  # bytes, more than the ends of a frame take
_PIECE = 2**20  # bytes
_AT_ONCE = 2**23  # bytes: as much may be taken on the claim of a length field, which is faster than piece by piece
_UNKNOWN = -1  # zstd's size of a frame whose writer did not know the size
SLICE = 2**10
"""Bytes of zstd frames that are decompressed at once: no more than 45 MB come out of as many."""

_WINDOW = 2**26  # bytes that one of several frames may look back, which takes memory beside what comes out


def check_claim(data: bytes | memoryview, compression: str, size: int) -> int:
    """Return how much is to be expected of data that claim to hold `size` bytes, without decompressing them.

    That is `size`, or less if nothing but the claim supports it: a damaged one may claim anything.

    Raises
    ------
    DECOMPRESS_ERRORS
        If they cannot hold `size` bytes.
    """
    most = _LZ4_RATIO * (len(data) + _LZ4_FRAME)
    match compression:
        case "lz4" if size > most:
            raise ValueError(f"{len(data)} bytes claim to hold {size}")
        case "zstd" if data and (first := zstandard.frame_content_size(data)) != size:
            if first > size:  # more frames may follow the first one, which holds less then
                raise ValueError(f"it holds {first} bytes and claims {size}")
            return min(size, max(first, most))
        case "" if len(data) != size:
            raise ValueError(f"it holds {len(data)} bytes and claims {size}")
        case "lz4" | "zstd" | "":
            return size
        case _:
            raise ValueError(f"unknown compression {compression:.40}")


def decompress(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Return the decompressed data of one frame or several, `size` bytes as claimed by the writer.

    Raises
    ------
    DECOMPRESS_ERRORS
        If they do not decompress, are of another size, or nobody knows the compression.
    """
    check_claim(data, compression, size)
    match compression:
        case "lz4":
            found = _lz4(data, size)
        case "zstd":
            found = _zstd(data, size)
        case _:
            found = bytes(data)
    if len(found) != size:
        raise ValueError(f"it holds {len(found)} bytes and claims {size}")
    return found


def decompress_frames(data: bytes, most: int) -> bytes:
    """Return what is in zstd frames that need not state its size.

    Raises
    ------
    DECOMPRESS_ERRORS
        If they do not decompress, or hold more than `most` bytes.
    """
    found = BytesIO()
    for piece in zstd_frames(data[place : place + SLICE] for place in range(0, len(data), SLICE)):
        found.write(piece)
        if found.tell() > most:
            raise ValueError(f"it holds more than {most} bytes")
    return found.getvalue()


def zstd_frames(slices: Iterable[bytes]) -> Iterator[bytes]:
    """Yield what comes out of zstd frames, some for each slice of at most `SLICE` bytes of them.

    Raises
    ------
    DECOMPRESS_ERRORS
        If they do not decompress, or the last one is cut off.
    """
    frame: Any = None
    for part in slices:
        rest = part
        while rest:
            frame = frame or zstandard.ZstdDecompressor(max_window_size=_WINDOW).decompressobj()
            yield frame.decompress(rest)
            rest = frame.unused_data if frame.eof else b""
            if frame.eof:
                frame = None
    if frame is not None:
        raise EOFError("its last frame is cut off")


def _lz4(data: bytes | memoryview, size: int) -> bytes:
    if size <= _AT_ONCE:
        frame: Any = lz4.frame.LZ4FrameDecompressor()
        # One byte more than claimed is enough to see that the claim is false.
        found: bytes = frame.decompress(data, max_length=size + 1)
        if frame.eof and not frame.unused_data:
            return found
    return _joined(_lz4_pieces(memoryview(data), size + 1))


def _lz4_pieces(data: memoryview, rest: int) -> Iterator[bytes]:
    """Yield what comes out of all frames piece by piece, `rest` bytes at most."""
    context = lz4.frame.create_decompression_context()
    position, whole = 0, True
    while rest and (position < len(data) or not whole):
        piece, taken, whole = lz4.frame.decompress_chunk(context, data[position:], max_length=min(_PIECE, rest))
        if not (piece or taken):
            break  # the last frame is cut off
        yield piece
        position += taken
        rest -= len(piece)
    if rest and not whole:
        raise EOFError("its last frame is cut off")


def _zstd(data: bytes | memoryview, size: int) -> bytes:
    if data and zstandard.frame_content_size(data) in (size, _UNKNOWN):
        with suppress(zstandard.ZstdError):  # more frames follow, or it is damaged
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)
    return _joined(_zstd_pieces(data, size + 1))


def _zstd_pieces(data: bytes | memoryview, rest: int) -> Iterator[bytes]:
    """Yield what comes out of all frames piece by piece, `rest` bytes at most."""
    decompressor = zstandard.ZstdDecompressor(max_window_size=_WINDOW)
    with decompressor.stream_reader(data, read_across_frames=True) as reader:
        while rest and (piece := reader.read(min(_PIECE, rest))):
            yield piece
            rest -= len(piece)


def _joined(pieces: Iterator[bytes]) -> bytes:
    """Join pieces as they come: memory is taken for the bytes there are, not for the claimed length."""
    found = BytesIO()
    found.writelines(pieces)
    return found.getvalue()
