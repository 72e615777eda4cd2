"""The log time of a recording: the clock on the wall, but never back."""

import logging
from collections.abc import Callable

logger = logging.getLogger(__name__)


class LogClock:
    """The clock of log times: where the system clock steps back, log time waits for it.

    A step back is reported, and not again before log time has caught up.

    Parameters
    ----------
    clock : callable
        The clock [ns].
    name : str
        What it is called in a line.
    """

    def __init__(self, clock: Callable[[], int], *, name: str = "the clock on the wall") -> None:
        self._clock = clock
        self._name = name
        self._last_ns = 0
        self._waits = False

    def now_ns(self) -> int:
        """Return the log time [ns], which is never less than the one before."""
        now_ns = self._clock()
        behind_ns = self._last_ns - now_ns
        if behind_ns > 0 and not self._waits:
            logger.warning(f"{self._name} stepped back by {behind_ns / 1e9:g} s: log time waits until it has caught up")
        self._waits = behind_ns > 0
        self._last_ns = max(self._last_ns, now_ns)
        return self._last_ns
