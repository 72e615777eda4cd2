"""The signals that end a verb: as exceptions, or as a question that a loop asks, where they are its ordinary end."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import Any

_AGAIN_S = 0.01


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
    if getattr(sys.unraisablehook, "func", None) is not _send_again:
        sys.unraisablehook = partial(_send_again, sys.unraisablehook)


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
        """Note a signal."""
        nonlocal stopped
        stopped = True

    earlier = {number: signal.getsignal(number) for number in _endings()}
    try:
        for number in earlier:
            signal.signal(number, note)
        yield lambda: stopped
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)


def _endings() -> tuple[signal.Signals, ...]:
    hang_up = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return (signal.SIGINT, signal.SIGTERM, *hang_up)


def _exit(signum: int, frame: FrameType | None) -> None:
    if threading.main_thread().is_alive():  # else it waits for the last threads, which no exception may cut short
        sys.exit(128 + signum)


def _send_again(otherwise: Callable[[Any], Any], unraisable: Any) -> None:
    """Send a signal again, whose exception fell into a finalizer or a callback: Python drops it there.

    A little later, as what is raised in here would be dropped as well.
    """
    error = unraisable.exc_value
    if isinstance(error, KeyboardInterrupt):
        number = int(signal.SIGINT)
    elif isinstance(error, SystemExit) and error.code in [128 + number for number in _endings()]:
        number = int(error.code) - 128
    else:
        otherwise(unraisable)
        return
    again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()
