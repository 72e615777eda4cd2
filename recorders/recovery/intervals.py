"""The steps between times that follow upon one another: their longest, their usual length, and how even they are."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isqrt

_NS_PER_S = 10**9
_DIGITS = 5  # leading binary digits that steps of one group share
_BURST_NS = 10_000_000  # messages within less have no rate
_FEWEST_STEPS = 2
_REGULAR_STEPS = 20  # fewer do not show what is usual
_REGULAR_SHARE = 5  # of as many steps at most one may be far from the usual length


@dataclass(slots=True)
class Intervals:
    """Takes in times one by one, and groups the steps between them by their length, so that they take no memory.

    Attributes
    ----------
    count, total_ns : int
        Number of steps that go forward or stand still, and their sum [ns].
    longest_ns, longest_after_ns : int
        The longest of them, and the time before it [ns].
    falls : int
        How often a time is before the one that came last.
    """

    count: int = 0
    total_ns: int = 0
    longest_ns: int = 0
    longest_after_ns: int = 0
    falls: int = 0
    _last_ns: int | None = None
    _groups: dict[int, tuple[int, int, int]] = field(default_factory=dict)  # number of steps, their sum, sum of squares

    def add(self, time_ns: int) -> None:
        """Take in a time [ns]."""
        last_ns, self._last_ns = self._last_ns, time_ns
        if last_ns is None:
            return
        step = time_ns - last_ns
        if step < 0:
            self.falls += 1
            return
        self.count += 1
        self.total_ns += step
        if step > self.longest_ns:
            self.longest_ns, self.longest_after_ns = step, last_ns
        shift = max(0, step.bit_length() - _DIGITS)
        key = step >> shift << shift
        count, total, squares = self._groups.get(key, (0, 0, 0))
        self._groups[key] = count + 1, total + step, squares + step * step

    @property
    def forward(self) -> int:
        """Number of steps that go forward."""
        return self.count - self._groups.get(0, (0, 0, 0))[0]

    @property
    def period_ns(self) -> int | None:
        """The usual length of a step [ns]; None if nothing is usual."""
        middle, seen = self.count // 2, 0
        for count, total, _ in self._sorted():
            seen += count
            if seen > middle:
                usual = total // count
                near, near_ns, _ = (sum(column) for column in zip(*self._near(usual), strict=True))
                regular = self.count >= _REGULAR_STEPS and near * _REGULAR_SHARE >= self.count * (_REGULAR_SHARE - 1)
                bursts = near_ns * _REGULAR_SHARE < self.total_ns  # most of the time passes between them
                return usual if usual and regular and not bursts else None
        return None

    @property
    def jitter_ns(self) -> int | None:
        """Standard deviation of the steps about as long as is usual [ns]; None if nothing is usual."""
        usual = self.period_ns
        if usual is None:
            return None
        count, total, squares = (sum(column) for column in zip(*self._near(usual), strict=True))
        jitter_ns: int = isqrt(count * squares - total * total) // count
        return jitter_ns

    @property
    def dropped(self) -> int | None:
        """How many times are missing in steps of twice the usual length and more; None if nothing is usual."""
        usual = self.period_ns
        if usual is None:
            return None
        lengths = ((count, (2 * total + count * usual) // (2 * count * usual)) for count, total, _ in self._sorted())
        return sum(count * (periods - 1) for count, periods in lengths if periods > 1)

    def _near(self, usual: int) -> Iterator[tuple[int, int, int]]:
        return (group for group in self._groups.values() if usual * group[0] <= 2 * group[1] <= 3 * usual * group[0])

    def _sorted(self) -> Iterator[tuple[int, int, int]]:
        return (group for _, group in sorted(self._groups.items()))


def rate_hz(steps: int, span_ns: int) -> float | None:
    """Return steps in a second [Hz]; None where too few of them, in too short a time, show none."""
    return steps * _NS_PER_S / span_ns if steps >= _FEWEST_STEPS and span_ns >= _BURST_NS else None
