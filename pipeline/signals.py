"""Ctrl-C and SIGTERM as a question that a loop asks, where they are the ordinary end of the work."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_ENDINGS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def until_stopped() -> Iterator[Callable[[], bool]]:
    """Hold both signals back while the block runs.

    Yields
    ------
    callable
        Whether one of them has come.
    """
    stopped = False

    def note(signum: int, frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    earlier = {number: signal.signal(number, note) for number in _ENDINGS}
    try:
        yield lambda: stopped
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)
