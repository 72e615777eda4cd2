"""Offsets and log times of the chunks of a log, from its summary section."""

import struct
from array import array
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from recorders.mcap_format.errors import damaged
from recorders.mcap_format.records import RawRecord

_FIXED = struct.Struct("<QQQQI")  # first and last log time, offset, length, length of the message indexes' offsets
_LENGTH = struct.Struct("<Q")
_LATEST_NS = 2**64 - 1


class Gap(NamedTuple):
    """A part of a file between two chunks [bytes], and the last time before it and the first one behind it [ns]."""

    start: int
    end: int
    before_ns: int
    behind_ns: int


class ChunkTable:
    """One row for each chunk, in 32 bytes: a log has a chunk for every 64 messages.

    Attributes
    ----------
    offsets, ends : array of int
        Where a chunk begins, and where its message indexes end [bytes].
    ordered : bool
        Whether the rows came in the order of the file, as every writer known makes them.
    """

    def __init__(self) -> None:
        self.offsets = array("Q")
        self.ends = array("Q")
        self._first_ns = array("Q")
        self._last_ns = array("Q")
        self.ordered = True

    def __len__(self) -> int:
        return len(self.offsets)

    def register(self, record: RawRecord) -> None:
        """Take in a chunk index.

        Raises
        ------
        DamagedLog
            If it is malformed, or its chunk does not stand before the index.
        """
        try:
            first_ns, last_ns, offset, length, skip = _FIXED.unpack_from(record.body)
            (indexes_length,) = _LENGTH.unpack_from(record.body, _FIXED.size + skip)
        except struct.error:
            raise damaged(record.offset, "a chunk index is malformed") from None
        end = offset + length + indexes_length
        if not offset < offset + length <= end <= record.offset:
            raise damaged(record.offset, f"its index has a chunk at byte {offset}, where none can stand")
        self.ordered &= not self.ends or self.ends[-1] <= offset
        for column, value in zip(self._columns(), (offset, end, first_ns, last_ns), strict=True):
            column.append(value)

    def skip_ranges(self, start_ns: int, end_ns: int) -> Mapping[int, int]:
        """Return where to go on [bytes] behind each run of chunks without a message in [start_ns, end_ns)."""
        skip_ranges: dict[int, int] = {}
        run, run_end = 0, 0
        for offset, end, first_ns, last_ns in zip(*self._columns(), strict=True):
            if first_ns < end_ns and last_ns >= start_ns:
                continue
            if offset != run_end:
                run = offset
            skip_ranges[run] = run_end = end
        return skip_ranges

    @property
    def in_order(self) -> bool:
        """Whether the summary states that chunks follow one another in time; one of the time 0 alone does not."""
        first, last = np.asarray(self._first_ns), np.asarray(self._last_ns)
        return bool((first[1:] >= last[:-1]).all() and (first <= last).all() and last.all())

    def gaps(self, start: int, end: int) -> Iterator[Gap]:
        """Yield where in [start, end) there is anything else than chunks [bytes]."""
        if not self.offsets:
            yield Gap(start, end, 0, _LATEST_NS)
            return
        yield Gap(start, self.offsets[0], 0, self._first_ns[0])
        for row in np.flatnonzero(np.asarray(self.offsets)[1:] != np.asarray(self.ends)[:-1]).tolist():
            yield Gap(self.ends[row], self.offsets[row + 1], self._last_ns[row], self._first_ns[row + 1])
        yield Gap(self.ends[-1], end, self._last_ns[-1], _LATEST_NS)

    def _columns(self) -> tuple["array[int]", ...]:
        return self.offsets, self.ends, self._first_ns, self._last_ns
