"""Decompression that believes no length: what comes out is never longer than what was claimed, nor is the memory."""

from collections.abc import Iterator

import lz4.frame
import zstandard

DECOMPRESS_ERRORS = (RuntimeError, ValueError, OverflowError, MemoryError, EOFError, zstandard.ZstdError)
"""What `decompress` raises for damaged data: the libraries have no common error."""

_LZ4_RATIO = 255  # bytes out for a byte in, at the very most: a longer match takes one more byte for every 255
_LZ4_FRAME = 32  # bytes, more than the ends of a frame take
_PIECE = 2**20  # bytes


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Return decompressed data of which its writer says that it has `size` bytes.

    Raises
    ------
    DECOMPRESS_ERRORS
        If it does not decompress, is of another size, or nobody knows the compression.
    """
    match compression:
        case "lz4":
            found = _lz4(data, size)
        case "zstd":
            found = _zstd(data, size)
        case "":
            found = data
        case _:
            raise ValueError(f"unknown compression {compression!r}")
    if len(found) != size:
        raise ValueError(f"it holds {len(found)} bytes and claims {size}")
    return found


def _lz4(data: bytes, size: int) -> bytes:
    if size > _LZ4_RATIO * (len(data) + _LZ4_FRAME):
        raise ValueError(f"{len(data)} bytes claim to hold {size}")
    # One byte more than claimed is enough to see that the claim is false.
    found: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return found


def _zstd(data: bytes, size: int) -> bytes:
    known = zstandard.frame_content_size(data)  # -1: the writer did not know
    if known not in (-1, size):
        raise ValueError(f"it holds {known} bytes and claims {size}")
    if known == size <= _PIECE:
        return zstandard.ZstdDecompressor().decompress(data)
    return b"".join(_pieces(data, size))


def _pieces(data: bytes, size: int) -> Iterator[bytes]:
    """Yield what comes out piece by piece: memory is taken for what is there, not for what a length field says."""
    rest = size + 1
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while rest and (piece := reader.read(min(_PIECE, rest))):
            yield piece
            rest -= len(piece)
