"""Simulated time: events in order of their time [ns], and of their making where times are equal."""

import heapq
import random
from collections.abc import Callable
from typing import Any

MS = 1_000_000  # [ns]
SECOND = 1_000 * MS

Do = Callable[..., object]


class BrokenPromiseError(Exception):
    """The protocol did not do as it promises.

    Parameters
    ----------
    promise : str
        The promise, in a few words: by them failures are told apart.
    found : str
        How it was broken.
    """

    def __init__(self, promise: str, found: str) -> None:
        super().__init__(f"{promise}: {found}")
        self.promise = promise


def draws(seed: int, purpose: str) -> random.Random:
    """Return the random numbers of one purpose: drawing more or fewer of them shifts those of no other."""
    return random.Random(f"{seed} {purpose}")


class World:
    """A clock, and what is to happen.

    Parameters
    ----------
    most_events, until_ns : int
        What has not ended after so many events, or at this time, does not end.

    Attributes
    ----------
    now_ns : int
        Simulated time.
    events : int
        How many have happened.
    trace : callable, optional
        Takes a line for everything that is worth one.
    """

    def __init__(self, *, most_events: int, until_ns: int) -> None:
        self.now_ns = 0
        self.events = 0
        self.trace: Callable[[str], None] | None = None
        self._most_events = most_events
        self._until_ns = until_ns
        self._made = 0
        self._waiting: list[tuple[int, int, Do, tuple[Any, ...]]] = []

    def at(self, time_ns: int, do: Do, *arguments: Any) -> None:
        """Let something happen at a time; what is past happens next."""
        self._made += 1
        heapq.heappush(self._waiting, (max(time_ns, self.now_ns), self._made, do, arguments))

    def after(self, delay_ns: int, do: Do, *arguments: Any) -> None:
        """Let something happen after a time."""
        self._made += 1
        heapq.heappush(self._waiting, (self.now_ns + delay_ns, self._made, do, arguments))

    def note(self, line: str) -> None:
        """Add a line to the trace, with the time."""
        if self.trace is not None:
            self.trace(f"{self.now_ns / SECOND:12.6f} s  {line}")

    def run(self, *, over: Callable[[], bool]) -> None:
        """Let everything happen until it is over.

        Raises
        ------
        BrokenPromiseError
            If it does not end.
        """
        waiting, pop = self._waiting, heapq.heappop
        while not over():
            if not waiting:
                raise BrokenPromiseError("it ends", f"nothing more happens after {self.now_ns / SECOND:.1f} s")
            if self.events >= self._most_events or self.now_ns > self._until_ns:
                raise BrokenPromiseError("it ends", f"not within {self.events} events, at {self.now_ns / SECOND:.1f} s")
            self.now_ns, _, do, arguments = pop(waiting)
            self.events += 1
            do(*arguments)
