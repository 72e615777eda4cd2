"""Decompression that believes no length: what comes out is never longer than what was claimed, nor is the memory."""

from collections.abc import Iterator
from io import BytesIO

import lz4.frame
import zstandard

DECOMPRESS_ERRORS = (RuntimeError, ValueError, OverflowError, MemoryError, EOFError, zstandard.ZstdError)
"""What `decompress` raises for damaged data: the libraries have no common error."""

_LZ4_RATIO = 255  # bytes out for a byte in, at the very most: a longer match takes one more byte for every 255
_LZ4_FRAME = 32  # bytes, more than the ends of a frame take
_PIECE = 2**20  # bytes
_UNKNOWN = -1  # what zstd says of a frame whose writer did not know the size


def check_claim(data: bytes | memoryview, compression: str, size: int) -> int:
    """Return how much is to be expected of data that claim to hold `size` bytes, without decompressing them.

    That is `size`, or less if nothing but the claim says so: a damaged one may say anything.

    Raises
    ------
    DECOMPRESS_ERRORS
        If they cannot hold `size` bytes.
    """
    most = _LZ4_RATIO * (len(data) + _LZ4_FRAME)
    match compression:
        case "lz4" if size > most:
            raise ValueError(f"{len(data)} bytes claim to hold {size}")
        case "zstd" if (known := zstandard.frame_content_size(data)) != size:
            if known != _UNKNOWN:
                raise ValueError(f"it holds {known} bytes and claims {size}")
            return min(size, most)
        case "" if len(data) != size:
            raise ValueError(f"it holds {len(data)} bytes and claims {size}")
        case "lz4" | "zstd" | "":
            return size
        case _:
            raise ValueError(f"unknown compression {compression!r}")


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Return decompressed data of which its writer says that it has `size` bytes.

    Raises
    ------
    DECOMPRESS_ERRORS
        If it does not decompress, is of another size, or nobody knows the compression.
    """
    check_claim(data, compression, size)
    found = data
    if compression == "lz4":
        # One byte more than claimed is enough to see that the claim is false.
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression == "zstd":
        found = _zstd(data, size)
    if len(found) != size:
        raise ValueError(f"it holds {len(found)} bytes and claims {size}")
    return found


def _zstd(data: bytes, size: int) -> bytes:
    if zstandard.frame_content_size(data) == size <= _PIECE:
        return zstandard.ZstdDecompressor().decompress(data)
    found = BytesIO()  # grows as the pieces come, and none of them stays beside it
    found.writelines(_pieces(data, size))
    return found.getvalue()


def _pieces(data: bytes, size: int) -> Iterator[bytes]:
    """Yield what comes out piece by piece: memory is taken for what is there, not for what a length field says."""
    rest = size + 1
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while rest and (piece := reader.read(min(_PIECE, rest))):
            yield piece
            rest -= len(piece)
