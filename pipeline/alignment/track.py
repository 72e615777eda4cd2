"""Samples of one topic in the order of their stamps, and its values between them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alignment.blocks import Times
from pipeline.arrays import Floats
from pipeline.rotations import great_arc

WAIT_NS = 10 * 10**9
"""A tick waits for a topic until another is so far ahead of it [ns]: one that falls silent must not fill the memory."""

NEVER = -(2**62)

_POSITION = 3


class Span(NamedTuple):
    """Samples about some ticks: the last not after each, the first not before it, and whether they make it."""

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    near: NDArray[np.bool_]


class Track:
    """Samples of one topic.

    Parameters
    ----------
    size : int
        Values of a sample.
    turns : bool
        Whether they are a position [m] and a unit quaternion, and not plain numbers.

    Attributes
    ----------
    stamps_ns : ndarray, shape (m,)
        Stamps of the samples that may still be needed, rising [ns].
    """

    def __init__(self, size: int, *, turns: bool) -> None:
        self._turns = turns
        self.stamps_ns: Times = np.empty(0, np.int64)
        self._values: Floats = np.empty((0, size))
        self._ahead_ns: Times = np.empty(0, np.int64)

    @property
    def last_ns(self) -> int:
        """Stamp of the latest sample [ns]; `NEVER` before the first."""
        return int(self.stamps_ns[-1]) if len(self.stamps_ns) else NEVER

    def add(self, stamps_ns: Times, values: Floats, ahead_ns: Times) -> None:
        """Take in samples that are on time.

        Parameters
        ----------
        stamps_ns : ndarray, shape (m,)
            Their stamps [ns].
        values : ndarray, shape (m, size)
            Their values.
        ahead_ns : ndarray, shape (m,)
            Latest stamp, of any topic, that had arrived before each [ns].
        """
        self.stamps_ns = np.concatenate((self.stamps_ns, stamps_ns))
        self._values = np.concatenate((self._values, values))
        self._ahead_ns = np.concatenate((self._ahead_ns, ahead_ns))

    def span(self, ticks_ns: Times, tolerance_ns: int) -> Span:
        """Return the samples about ticks: a tick is near if both are within the tolerance, and came before it was late.

        Parameters
        ----------
        ticks_ns : ndarray, shape (n,)
            Ticks, rising [ns].
        tolerance_ns : int
            How far off they may be [ns].
        """
        stamps, last = self.stamps_ns, len(self.stamps_ns) - 1
        if last < 0:
            nothing = np.zeros(len(ticks_ns), np.intp)
            return Span(nothing, nothing, np.zeros(len(ticks_ns), np.bool_))
        found = np.searchsorted(stamps, ticks_ns, side="right") - 1
        before = np.maximum(found, 0)
        exact = stamps[before] == ticks_ns
        after = np.where(exact, before, np.minimum(found + 1, last))
        near = (found >= 0) & (stamps[after] >= ticks_ns)
        near &= (ticks_ns - stamps[before] <= tolerance_ns) & (stamps[after] - ticks_ns <= tolerance_ns)
        near &= self._ahead_ns[after] - ticks_ns <= WAIT_NS
        return Span(before, after, near)

    def between(self, ticks_ns: Times, span: Span) -> Floats:
        """Return the values at ticks, shape (n, size), between the samples about them.

        Numbers are on the straight line between two samples, rotations on the great arc; at a sample they are its own,
        to the bit.
        """
        start, end = self.stamps_ns[span.before], self.stamps_ns[span.after]
        whole = np.maximum(end - start, 1)
        fraction = (ticks_ns - start).astype(np.float64) / whole.astype(np.float64)
        here, there = self._values[span.before], self._values[span.after]
        found = here + (there - here) * fraction[:, None]
        if self._turns:
            found[:, _POSITION:] = great_arc(here[:, _POSITION:], there[:, _POSITION:], fraction)
        return np.where((span.before == span.after)[:, None], here, found)

    def forget_before(self, tick_ns: int) -> None:
        """Forget what no tick after this one [ns] can need."""
        first = int(np.searchsorted(self.stamps_ns, tick_ns, side="right")) - 1
        if first > 0:
            self.stamps_ns = self.stamps_ns[first:].copy()
            self._values = self._values[first:].copy()
            self._ahead_ns = self._ahead_ns[first:].copy()
