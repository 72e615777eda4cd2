"""The signals that end a verb: as exceptions, or as a question that a loop asks, where they are its ordinary end."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


def end_by_exceptions() -> None:
    """Turn the signals that end a verb into exceptions, so that every open file and session is finished on the way out.

    Ctrl-C is handled even where a shell without job control started this process in the background, and had SIGINT
    ignored.
    SIGHUP, by which a closed terminal ends what runs in it, stays ignored if it was: that is what nohup is for.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in _endings():
        if number != signal.SIGINT:
            signal.signal(number, _exit)


@contextmanager
def until_stopped() -> Iterator[Callable[[], bool]]:
    """Hold these signals back while the block runs.

    Yields
    ------
    callable
        Whether one of them has come.
    """
    stopped = False

    def note(signum: int, frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    earlier = {number: signal.signal(number, note) for number in _endings()}
    try:
        yield lambda: stopped
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)


def _endings() -> tuple[signal.Signals, ...]:
    hang_up = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return (signal.SIGINT, signal.SIGTERM, *hang_up)


def _exit(signum: int, frame: FrameType | None) -> None:
    sys.exit(128 + signum)
