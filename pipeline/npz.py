"""Named arrays and texts in the bytes of an .npz: the same content gives the same bytes, and no file can hurt.

numpy's own reader trusts sizes and shapes that a file claims. Here a member is float64, or UTF-8 text in bytes; its
claims are checked against the bytes that are there, and nothing is ever unpickled.
"""

import io
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from recorders.errors import ControllerError

MAX_BYTES = 512 * 2**20  # of a file, and of everything in it unpacked

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold: no wall clock in the file
_ZIP_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError),
    *(NotImplementedError, OSError, OverflowError, RuntimeError, ValueError),
)
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what numpy writes; other unpackers are not let near the file
_MAX_HEADER = 2**10  # bytes
_MAGIC = b"\x93NUMPY\x01\x00"
# numpy writes a header of version 1.0 in this form alone, and evaluates what it reads as an expression.
_HEADER = re.compile(
    rb"\{'descr': '([^']{1,40})', 'fortran_order': (False|True), 'shape': \(((?:\d{1,25}, ?)*(?:\d{1,25})?)\), \} *\n"
)

Member = str | NDArray[np.float64]


def pack(members: Mapping[str, Member]) -> bytes:
    """Write members, in their order, uncompressed, so that no zlib version enters the bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, member in members.items():
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), _pack_member(member))
    return buffer.getvalue()


def unpack(data: bytes) -> dict[str, Member]:
    """Read members, by name.

    Raises
    ------
    ControllerError
        If the bytes are no .npz, are damaged, claim more than `MAX_BYTES`, or hold other types.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            size = sum(entry.file_size for entry in entries)
            if size > MAX_BYTES:
                raise ControllerError(f"expected at most {MAX_BYTES} bytes unpacked, found a claim of {size}")
            return {entry.filename.removesuffix(".npy"): _unpack_member(entry, archive) for entry in entries}
    except _ZIP_ERRORS as error:
        raise ControllerError(f"expected an undamaged .npz: {' '.join(str(error).split())}") from error


def _pack_member(member: Member) -> bytes:
    buffer = io.BytesIO()
    if isinstance(member, str):
        npy.write_array(buffer, np.frombuffer(member.encode(), dtype="|u1"), version=(1, 0), allow_pickle=False)
    else:
        npy.write_array(buffer, np.ascontiguousarray(member, "<f8"), version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def _unpack_member(entry: zipfile.ZipInfo, archive: zipfile.ZipFile) -> Member:
    name = f"{entry.filename!r:.80}"
    if entry.compress_type not in _PACKINGS:
        raise ControllerError(f"expected member {name} stored or deflated, found packing {entry.compress_type}")
    data = archive.read(entry)
    descr, shape, content = _unpack_header(name, data)
    dtype = np.dtype(descr)
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ControllerError(f"expected member {name} of shape {shape}, found {len(content)} bytes")
    if descr == "|u1":
        return content.decode()
    return np.frombuffer(content, dtype=dtype).astype(np.float64).reshape(shape)


def _unpack_header(name: str, data: bytes) -> tuple[str, tuple[int, ...], bytes]:
    """Type, shape and content of the bytes of an .npy."""
    start = len(_MAGIC) + 2
    end = start + int.from_bytes(data[start - 2 : start], "little")
    header = _HEADER.fullmatch(data, start, min(end, start + _MAX_HEADER)) if data.startswith(_MAGIC) else None
    if header is None or end > len(data):
        raise ControllerError(f"expected member {name} in .npy version 1.0")
    descr = header[1].decode("ascii", "replace")
    if descr not in ("<f8", "|u1") or header[2] == b"True":
        raise ControllerError(f"expected member {name} of float64 or text, found {descr}")
    return descr, tuple(map(int, header[3].replace(b",", b" ").split())), data[end:]
