"""Cuts a block short wherever a signal may raise its exception, one place after the other."""

import contextlib
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from waiting import wait_until

import pipeline

_OURS = tuple(str(Path(pipeline.__file__).parent.parent / package) for package in ("pipeline", "replay", "recorders"))
# Of `threading`, where a thread is started and waited for. Python's own locks are lost where their `__enter__` is cut.
_THREADING = {
    function.__code__
    for function in (
        threading.Thread.start,
        threading.Thread.join,
        threading.Event.wait,
        threading.Condition.wait,
    )
}


class CutError(BaseException):
    """What a signal raises."""


def cut_everywhere(block: Callable[[], AbstractContextManager[object]]) -> int:
    """Enter and leave a block, cut short at each place in turn; return how many places there are.

    After each, no thread that was started may be left.
    """
    before = set(threading.enumerate())
    places = 0
    while _is_cut_short(block, places):
        wait_until(lambda: not _left(before))  # one that was about to begin ends at once
        places += 1
    assert not _left(before)
    return places


def _is_cut_short(block: Callable[[], AbstractContextManager[object]], place: int) -> bool:
    try:
        _run(block, place)
    except CutError:
        return True
    return False


def _run(block: Callable[[], AbstractContextManager[object]], place: int) -> None:
    """Run a block; CutError is raised where Python looks for signals: as a function begins, and after one in C."""
    passed = 0

    def cut(frame: FrameType, event: str, function: Any) -> None:
        nonlocal passed
        if event not in ("call", "c_return") or not _is_looked_at(frame.f_code, function):
            return
        if passed == place:
            raise CutError  # which ends the profiling
        passed += 1

    made = block()
    sys.setprofile(cut)
    try:
        with made:
            pass
    finally:
        sys.setprofile(None)


def _is_looked_at(code: CodeType, function: Any) -> bool:
    if code in _THREADING:  # where a lock is left there, a thread is noted that never begins
        return getattr(function, "__name__", "") != "__exit__"
    return code.co_filename == contextlib.__file__ or code.co_filename.startswith(_OURS)


def _left(before: set[threading.Thread]) -> list[threading.Thread]:
    """Return our threads that run beside those that ran before; those of Zenoh end with its session."""
    return [thread for thread in threading.enumerate() if thread not in before and not _is_of_zenoh(thread)]


def _is_of_zenoh(thread: threading.Thread) -> bool:
    return isinstance(thread, threading._DummyThread) or "pyo3" in thread.name
