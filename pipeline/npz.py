"""Named arrays and texts in the bytes of an .npz: the same content gives the same bytes, and no file can hurt.

numpy's own reader trusts sizes and shapes that a file claims. Here a member is float64, or UTF-8 text in bytes; its
claims are checked against the bytes that are there, and nothing is ever unpickled.
"""

import io
import math
import zipfile
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from recorders.errors import ControllerError

MAX_BYTES = 512 * 2**20  # of a file, and of everything in it unpacked

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold: no wall clock in the file
_ZIP_ERRORS = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, RuntimeError, ValueError)

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
    data = archive.read(entry)
    buffer = io.BytesIO(data)
    if npy.read_magic(buffer) != (1, 0):
        raise ControllerError(f"expected member {entry.filename} in .npy version 1.0")
    shape, fortran_order, dtype = npy.read_array_header_1_0(buffer)
    if dtype.str not in ("<f8", "|u1") or fortran_order:
        raise ControllerError(f"expected member {entry.filename} of float64 or text, found {dtype}")
    content = data[buffer.tell() :]
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ControllerError(f"expected member {entry.filename} of shape {shape}, found {len(content)} bytes")
    if dtype.str == "|u1":
        return content.decode()
    return np.frombuffer(content, dtype="<f8").astype(np.float64).reshape(shape)
