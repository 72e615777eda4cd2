"""Order of stamps: lone messages far ahead are left out, and stamps that all go on elsewhere are of another clock."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alignment.blocks import Times
from pipeline.alignment.track import NEVER, WAIT_NS

LEAP_NS = 60 * 10**9
"""A stamp this far ahead of all before it [ns] is taken once others of its topic go on there."""

FOLLOWED_AFTER = 3
"""Messages in a row of one topic, each later by stamp than the one before, that are so far ahead."""

RESTARTED_AFTER = 10
"""Messages in a row of every topic that lie `WAIT_NS` behind what came before: the clock began anew."""


class Place(IntEnum):
    """Where a stamp lies: after those of its topic, not after them, or far ahead of all."""

    NEXT = 0
    LATE = 1
    AHEAD = 2


class Verdict(NamedTuple):
    """Where the stamps of some messages lie, and the index of the first at which the clock began anew, if one is."""

    places: NDArray[np.int8]
    restart: int | None


class StampOrder:
    """The latest stamps of some topics, and which can follow them.

    Parameters
    ----------
    topics : int
        How many topics there are; each is known by its rank.
    """

    _behind: list[int]  # messages of each topic in a row that are far behind
    _backs: list[int]  # the latest of their stamps [ns]

    def __init__(self, topics: int) -> None:
        self._topics = topics
        self.begin()

    def begin(self) -> None:
        """Begin with any stamp."""
        self._last = [NEVER] * self._topics
        self._ahead_ns: int = NEVER
        self._leaps, self._leapt = [0] * self._topics, [NEVER] * self._topics
        self._forget_restart()

    def check(self, ranks: NDArray[np.intp], stamps_ns: Times) -> Verdict:
        """Return where stamps lie; they are noted, unless the clock begins anew at one of them.

        Parameters
        ----------
        ranks : ndarray, shape (m,)
            Topics of the messages, in order of arrival.
        stamps_ns : ndarray, shape (m,)
            Their stamps [ns].
        """
        places = np.zeros(len(ranks), np.int8)
        if self._note_steady(ranks, stamps_ns):
            return Verdict(places, None)
        before = self._last.copy(), self._ahead_ns, self._leaps.copy(), self._leapt.copy()
        waiting = self._behind.copy(), self._backs.copy()
        for index, (rank, stamp) in enumerate(zip(ranks.tolist(), stamps_ns.tolist(), strict=True)):
            if self._restarts(rank, stamp):
                self._last, self._ahead_ns, self._leaps, self._leapt = before
                self._behind, self._backs = waiting
                return Verdict(places, index)
            places[index] = self._note(rank, stamp)
        return Verdict(places, None)

    def _note_steady(self, ranks: NDArray[np.intp], stamps_ns: Times) -> bool:
        """Note stamps if they all rise with no leap and none far behind, and return whether they do."""
        latest = np.maximum.accumulate(np.concatenate(([self._ahead_ns], stamps_ns)))
        if (np.abs(stamps_ns - latest[:-1]) > WAIT_NS).any():
            return False
        ends = self._last.copy()
        for rank in np.unique(ranks).tolist():
            own = stamps_ns[ranks == rank]
            if own[0] <= ends[rank] or (own[1:] <= own[:-1]).any():
                return False
            ends[rank] = int(own[-1])
            self._leaps[rank] = 0
        if len(ranks):
            self._forget_restart()
        self._last, self._ahead_ns = ends, int(latest[-1])
        return True

    def _note(self, rank: int, stamp: int) -> Place:
        """Note one stamp, and return where it lies."""
        if self._ahead_ns != NEVER and stamp > self._ahead_ns + LEAP_NS:
            self._leaps[rank] = self._leaps[rank] + 1 if stamp > self._leapt[rank] else 1
            self._leapt[rank] = stamp
            if self._leaps[rank] < FOLLOWED_AFTER:
                return Place.AHEAD
        self._leaps[rank], self._leapt[rank] = 0, NEVER
        if stamp <= self._last[rank]:
            return Place.LATE
        if stamp >= self._ahead_ns - WAIT_NS:
            self._forget_restart()
        self._last[rank], self._ahead_ns = stamp, max(self._ahead_ns, stamp)
        return Place.NEXT

    def _restarts(self, rank: int, stamp: int) -> bool:
        """Note a stamp if it is far behind, and return whether all topics now go on there."""
        if stamp >= self._ahead_ns - WAIT_NS:
            return False
        self._behind[rank] = self._behind[rank] + 1 if stamp > self._backs[rank] else 1
        self._backs[rank] = stamp
        return min(self._behind) >= RESTARTED_AFTER

    def _forget_restart(self) -> None:
        self._behind, self._backs = [0] * self._topics, [NEVER] * self._topics
