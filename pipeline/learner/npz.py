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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.lib import format as npy

from pipeline.arrays import Floats
from recorders.errors import ControllerError
from recorders.text.wording import line_text, value_text

MAX_BYTES = 12 * 2**20  # of a file, and of everything in it unpacked
MAX_MEMBERS = 128

_MAX_DIRECTORY = 2**16  # bytes
_END = struct.Struct("<4s4H2LH")  # of a zip without a comment: what is no part of it cannot stand behind it
_END_MAGIC = b"PK\x05\x06"

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

Member = str | Floats


def pack(members: Mapping[str, Member]) -> bytes:
    """Write members, in their order, uncompressed, so that no zlib version enters the bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, member in members.items():
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), _pack_member(member))
    return buffer.getvalue()


class Npz:
    """The members of an .npz, whose claims are checked before anything is unpacked.

    Parameters
    ----------
    data : bytes
        The file.

    Raises
    ------
    ControllerError
        If the bytes are no .npz, or claim more than `MAX_BYTES` or `MAX_MEMBERS`, a name twice or a place twice.
    """

    def __init__(self, data: bytes) -> None:
        _check_directory(data)
        with _one_line():
            self._archive = zipfile.ZipFile(io.BytesIO(data))
        self._entries = {entry.filename.removesuffix(".npy"): entry for entry in self._archive.infolist()}
        _check_entries(self._archive.infolist(), names=len(self._entries), size=len(data))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the members, in their order."""
        return tuple(self._entries)

    def holds(self, name: str, count: int) -> bool:
        """Whether a member claims what an array of so many numbers takes."""
        return 0 <= self._entries[name].file_size - count * 8 <= len(_MAGIC) + 2 + _MAX_HEADER

    def read(self, name: str, *, most: int = MAX_BYTES) -> Member:
        """Unpack a member.

        Parameters
        ----------
        name : str
            One of `names`.
        most : int
            Bytes that it may take.

        Raises
        ------
        ControllerError
            If it is larger, damaged, or of another type.
        """
        entry = self._entries[name]
        if entry.file_size > most:
            raise ControllerError(f"expected member {_name(entry)} of at most {most} bytes, found {entry.file_size}")
        with _one_line():
            return _unpack_member(entry, self._archive)


def unpack(data: bytes) -> dict[str, Member]:
    """Read members, by name.

    Raises
    ------
    ControllerError
        If the bytes are no .npz, are damaged, claim too much, or hold other types.
    """
    archive = Npz(data)
    return {name: archive.read(name) for name in archive.names}


@contextmanager
def _one_line() -> Iterator[None]:
    """Make one error of whatever the zip reader raises."""
    try:
        yield
    except _ZIP_ERRORS as error:
        raise ControllerError(f"expected an undamaged .npz: {line_text(str(error))}") from error


def _check_directory(data: bytes) -> None:
    """Check that a directory stands at the end, and how large it is: the zip reader takes it in whole."""
    end = data[-_END.size :]
    if len(end) < _END.size or not end.startswith(_END_MAGIC):
        raise ControllerError("expected an undamaged .npz, found one that is cut off or not a zip file")
    _, _, _, _, count, size, _, _ = _END.unpack(end)
    if count > MAX_MEMBERS or size > _MAX_DIRECTORY:
        raise ControllerError(f"expected at most {MAX_MEMBERS} members, found a directory of {count} in {size} bytes")


def _check_entries(entries: list[zipfile.ZipInfo], *, names: int, size: int) -> None:
    if len(entries) > MAX_MEMBERS or names != len(entries):
        raise ControllerError(f"expected at most {MAX_MEMBERS} members of different names, found {len(entries)}")
    unpacked = sum(entry.file_size for entry in entries)
    if unpacked > MAX_BYTES:
        raise ControllerError(f"expected at most {MAX_BYTES} bytes unpacked, found a claim of {unpacked}")
    places = sorted((entry.header_offset, entry.compress_size) for entry in entries)
    ends = [offset + length for offset, length in places]
    if any(end > offset for end, (offset, _) in zip(ends, [*places[1:], (size, 0)], strict=False)):
        raise ControllerError("expected members side by side, found some that overlap")


def _pack_member(member: Member) -> bytes:
    buffer = io.BytesIO()
    if isinstance(member, str):
        npy.write_array(buffer, np.frombuffer(member.encode(), dtype="|u1"), version=(1, 0), allow_pickle=False)
    else:
        npy.write_array(buffer, np.ascontiguousarray(member, "<f8"), version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def _name(entry: zipfile.ZipInfo) -> str:
    return value_text(entry.filename)


def _unpack_member(entry: zipfile.ZipInfo, archive: zipfile.ZipFile) -> Member:
    name = _name(entry)
    if entry.compress_type not in _PACKINGS:
        raise ControllerError(f"expected member {name} stored or deflated, found packing {entry.compress_type}")
    with archive.open(entry) as member:
        data = member.read(entry.file_size)  # no more is unpacked, whatever more there is
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
