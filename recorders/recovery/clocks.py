"""Clocks of a log's producers: how the stamps of topics lie to one another that were recorded at the same time."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from math import sqrt
from typing import Any, Protocol

_FEWEST = 10  # messages that show a clock
_APART_NS = 10**8  # stamps that are less apart make no difference to an alignment as it is by default
_CERTAIN = 20  # how many times the scatter of the stamps about their line a difference has to be
_NS = 1e9


@dataclass(slots=True)
class ClockLine:
    """The straight line by which stamps are ahead of log time, over log time: of all there are, in no memory.

    Attributes
    ----------
    count : int
        Number of stamps.
    first_ns, last_ns : int
        Least and greatest log time [ns].
    """

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    _origin: tuple[int, int] = (0, 0)
    _times: int = 0
    _ahead: int = 0
    _squares: tuple[int, int, int] = (0, 0, 0)  # of times, of times and ahead, of ahead

    def add(self, log_time_ns: int, ahead_ns: int) -> None:
        """Take in a stamp that is so far ahead of its log time [ns]."""
        if not self.count:
            self._origin, self.first_ns, self.last_ns = (log_time_ns, ahead_ns), log_time_ns, log_time_ns
        time, ahead = log_time_ns - self._origin[0], ahead_ns - self._origin[1]
        self.count += 1
        self.first_ns, self.last_ns = min(self.first_ns, log_time_ns), max(self.last_ns, log_time_ns)
        self._times += time
        self._ahead += ahead
        of_times, of_both, of_ahead = self._squares
        self._squares = of_times + time * time, of_both + time * ahead, of_ahead + ahead * ahead

    @property
    def slope(self) -> float:
        """How much faster the clock runs than log time: 1e-3 for a millisecond a second."""
        spread, both, _ = self._spreads()
        return both / spread if spread else 0.0

    @property
    def scatter_ns(self) -> float:
        """Standard deviation of the stamps about the line [ns]."""
        spread, both, ahead = self._spreads()
        left = ahead - both * both / spread if spread else float(ahead)
        return sqrt(max(left, 0.0)) / self.count

    def at(self, log_time_ns: int) -> float:
        """Return how far stamps are ahead of a log time [ns]."""
        middle = log_time_ns - self._origin[0] - self._times / self.count
        return self._origin[1] + self._ahead / self.count + self.slope * middle

    def _spreads(self) -> tuple[int, int, int]:
        """Return the squares about the means, times the square of the count."""
        times, both, ahead = self._squares
        count = self.count
        return (
            count * times - self._times * self._times,
            count * both - self._times * self._ahead,
            count * ahead - self._ahead * self._ahead,
        )


class StampedTopic(Protocol):
    """A topic with stamps."""

    topic: str
    clock: ClockLine


@dataclass(frozen=True)
class Disagreement:
    """Stamps of a topic that are not of the clock of another's.

    Attributes
    ----------
    topic, other : str
        The topics; the other is one of those that most agree with.
    ahead_ns : int
        How far stamps of the first are ahead of those of the other, half-way through [ns].
    drift_ns : int or None
        How much that changes over the time that they have in common [ns]; None if it does not.
    """

    topic: str
    other: str
    ahead_ns: int
    drift_ns: int | None

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        drift_s = None if self.drift_ns is None else self.drift_ns / _NS
        return {"topic": self.topic, "other": self.other, "ahead_s": self.ahead_ns / _NS, "drift_s": drift_s}


def disagreements(topics: Iterable[StampedTopic]) -> Iterator[Disagreement]:
    """Yield the topics whose stamps are of another clock than those of most.

    Topics that were not recorded at the same time are not compared, nor those with stamps that come and go, as of a log
    that is presented again and again.

    Parameters
    ----------
    topics : iterable of StampedTopic
        All topics of a log.
    """
    known = [topic for topic in topics if topic.clock.count >= _FEWEST]
    pairs = {(one.topic, two.topic): _compare(one, two) for one in known for two in known if one is not two}
    others = {topic.topic: [pairs[topic.topic, two.topic] for two in known if two is not topic] for topic in known}
    alike = {name: sum(found is None for found in compared) for name, compared in others.items()}
    reference = max(known, key=lambda topic: (alike[topic.topic], topic.clock.count), default=None)
    if reference is not None:
        found = (pairs[topic.topic, reference.topic] for topic in known if topic is not reference)
        yield from chain.from_iterable((each,) if each is not None else () for each in found)


def _compare(topic: StampedTopic, other: StampedTopic) -> Disagreement | None:
    """Return how stamps of two topics disagree; None if they do not, or it cannot be told."""
    one, two = topic.clock, other.clock
    start, end = max(one.first_ns, two.first_ns), min(one.last_ns, two.last_ns)
    if 2 * (end - start) < min(one.last_ns - one.first_ns, two.last_ns - two.first_ns):
        return None
    middle = (start + end) // 2
    ahead, drift = one.at(middle) - two.at(middle), (one.slope - two.slope) * (end - start)
    certain = _CERTAIN * max(one.scatter_ns, two.scatter_ns)
    drifts = abs(drift) > max(_APART_NS, certain)
    if not drifts and abs(ahead) <= max(_APART_NS, certain):
        return None
    return Disagreement(topic.topic, other.topic, round(ahead), round(drift) if drifts else None)
