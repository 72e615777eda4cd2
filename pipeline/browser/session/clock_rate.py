"""Rate of the robot's clock beside that of this machine: a simulation on a machine that is busy is slower."""

from collections import deque

_SPAN_S = 5.0
_LEAST_S = 2.0  # over less than this it says little
_NS_PER_S = 1e9


class ClockRate:
    """Rate of the robot's clock over the last seconds."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()

    def add(self, now_s: float, time_ns: int) -> float | None:
        """Take the time of this machine [s] and the robot's [ns]; return the rate, None where too little was seen.

        A clock that began anew is another one.
        """
        if self._seen and time_ns < self._seen[-1][1]:
            self._seen.clear()
        self._seen.append((now_s, time_ns))
        while now_s - self._seen[0][0] > _SPAN_S:
            self._seen.popleft()
        begin_s, begin_ns = self._seen[0]
        if now_s - begin_s < _LEAST_S:
            return None
        return (time_ns - begin_ns) / _NS_PER_S / (now_s - begin_s)

    def clear(self) -> None:
        """Forget what was seen: the robot was away."""
        self._seen.clear()
