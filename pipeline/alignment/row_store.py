"""Rows of ticks, in memory while they are few and in a file of no name when they are many."""

import weakref
from collections.abc import Iterator
from tempfile import SpooledTemporaryFile

from pipeline.alignment.rows import ROW_HEAD

IN_MEMORY = 64 << 20
"""Rows that take more lie in a file [bytes]."""

_READ = 1 << 20  # bytes at a time


class RowStore:
    """Rows of one size, in the order of their stamps.

    Parameters
    ----------
    size : int
        Bytes of a row.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._file = SpooledTemporaryFile(max_size=IN_MEMORY)  # noqa: SIM115  # lives as long as this
        self._count = 0
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return self._count

    def append(self, rows: bytes) -> None:
        """Put whole rows at the end."""
        self._file.seek(self._count * self._size)
        self._file.write(rows)
        self._count += len(rows) // self._size

    def rows(self, start_ns: int, end_ns: int) -> Iterator[bytes]:
        """Yield the rows of stamps [start_ns, end_ns), many at a time."""
        place, end = self._find(start_ns), self._find(end_ns)
        many = max(_READ // self._size, 1)
        while place < end:
            count = min(many, end - place)
            yield self._read(place, count)
            place += count

    def stamp(self, place: int) -> int:
        """Return the stamp of a row [ns]."""
        found: int = ROW_HEAD.unpack_from(self._read(place, 1))[0]
        return found

    def _find(self, stamp_ns: int) -> int:
        """Return how many rows are of earlier stamps."""
        low, high = 0, self._count
        while low < high:
            middle = (low + high) // 2
            if self.stamp(middle) < stamp_ns:
                low = middle + 1
            else:
                high = middle
        return low

    def _read(self, place: int, count: int) -> bytes:
        self._file.seek(place * self._size)
        return self._file.read(count * self._size)
