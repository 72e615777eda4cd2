"""Callbacks that Zenoh makes on its own thread that reads from the network: no other thread need wake for them."""

import ctypes
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

import zenoh

logger = logging.getLogger(__name__)

_Received = TypeVar("_Received")
_Declared = TypeVar("_Declared")

_LAST_WAIT_S = 10.0  # a handler returns at once
_hold_state = ctypes.pythonapi.PyGILState_Ensure
_OF_THREAD = threading.local()  # is there as long as the state is


@contextmanager
def on_network_thread(
    declare: Callable[["zenoh.handlers.Callback[Any]"], AbstractContextManager[_Declared]],
    handler: Callable[[_Received], None],
) -> Iterator[_Declared]:
    """Declare something with a callback that has no queue and no thread of its own, while the block runs.

    The handler keeps the network waiting. When the block is left, no call is under way any more, and none can come: one
    that waited to run while the interpreter ends would abort the process. Who leaves the block must hold no lock that
    the handler takes; a handler that leaves it itself is not waited for.

    Python gives a thread that is none of its own a state when it calls in, and takes it away when it returns: the
    state's stack is mapped into memory and unmapped again for every call, which takes longer than most handlers. So
    the first call on a thread takes hold of the state once more than it is given up. It stays until the interpreter
    ends, even if the thread does not: Zenoh reads on a few threads, and seldom on a new one.

    Parameters
    ----------
    declare : callable
        Declares a subscriber or a queryable with the callback that it is given; undeclared at the end of the block.
    handler : callable
        Takes what comes.
    """
    in_use = threading.Lock()
    in_use.acquire()

    def on_thread(received: _Received) -> None:
        try:
            under_way = _OF_THREAD.under_way
        except AttributeError:
            under_way = _hold_thread()
        under_way.append(in_use)
        try:
            handler(received)
        finally:
            under_way.pop()

    # Zenoh releases the lock when nothing of it can call any more. A method in C, as no other thread runs within it.
    is_declared = False
    try:
        with declare(zenoh.handlers.Callback(on_thread, drop=in_use.release, indirect=False)) as declared:
            is_declared = True
            yield declared
    finally:
        is_within = in_use in getattr(_OF_THREAD, "under_way", ())
        if is_declared and not is_within and not in_use.acquire(timeout=_LAST_WAIT_S):
            logger.warning(f"a callback of Zenoh's has not returned within {_LAST_WAIT_S:g} s")


def _hold_thread() -> list[Any]:
    """Hold on to the state of this thread, and return the calls that are under way on it: none yet."""
    _hold_state()
    under_way: list[Any] = []
    _OF_THREAD.under_way = under_way
    return under_way
