"""Detects that stamps out of time come from a clock that began anew, and are no longer late or stray messages."""

import time

from pipeline.serving.rejections import Rejection

RESTART_AFTER = 10
"""Ticks in a row that must be out of time: more than are under way between two nodes, and two seconds at 5 Hz."""

LEAP_NS = 10 * 10**9
"""How much farther than time has passed a stamp may leap: a recording that is played fast has gaps."""


class ClockResetDetector:
    """Detects that every topic of a tick goes on, message after message, away from what was answered last.

    Parameters
    ----------
    topics : int
        How many topics a tick has; each is known by its place.

    Attributes
    ----------
    noted : bool
        Whether there is something to forget.
    """

    def __init__(self, topics: int) -> None:
        self._topics = topics
        self.reset()

    def reset(self) -> None:
        """Forget what was noted: a tick was answered, or a cycle begun."""
        self.noted = False
        self._stamps = [-1] * self._topics
        self._counts = [0] * self._topics

    def note(self, place: int, stamp: int) -> bool:
        """Note a message out of time; True once `RESTART_AFTER` in a row rose on every topic."""
        self.noted = True
        rises = stamp > self._stamps[place]
        self._counts[place] = self._counts[place] + 1 if rises else 1
        self._stamps[place] = stamp
        return min(self._counts) >= RESTART_AFTER


class StampOrder:
    """The stamp of the tick that was answered last, and which stamps can follow it.

    Parameters
    ----------
    topics : int
        How many topics a tick has.

    Attributes
    ----------
    last_ns : int
        Stamp of the last tick answered [ns]; -1 before the first of a cycle.
    """

    def __init__(self, topics: int) -> None:
        self._watches = {reason: ClockResetDetector(topics) for reason in (Rejection.STALE, Rejection.AHEAD)}
        self.begin()

    def begin(self, last_ns: int = -1) -> None:
        """Begin a cycle: with any stamp, or after one of the clock that is followed from now on."""
        self.last_ns = last_ns
        self.note_answer()

    def note_answer(self) -> None:
        """Note that a tick has been answered just now."""
        self._answered_ns = time.monotonic_ns()
        for watch in self._watches.values():
            if watch.noted:
                watch.reset()

    def is_ahead(self, stamp: int) -> bool:
        """Whether a stamp is farther from the last than time can have passed, by any clock that runs as ours does."""
        leap = stamp - self.last_ns
        return leap > LEAP_NS and self.last_ns >= 0 and leap > LEAP_NS + time.monotonic_ns() - self._answered_ns

    def rejection(self, stamp: int) -> Rejection | None:
        """Return why a stamp cannot follow, None if it can."""
        if stamp <= self.last_ns:
            return Rejection.STALE
        return Rejection.AHEAD if self.is_ahead(stamp) else None

    def goes_on(self, reason: Rejection, place: int, stamp: int) -> bool:
        """Note a message that was rejected; True once enough of them went on where it is."""
        return self._watches[reason].note(place, stamp)
