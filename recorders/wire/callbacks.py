"""Callbacks that Zenoh makes on its own thread that reads from the network: no other thread need wake for them."""

import ctypes
import threading
from collections.abc import Callable
from typing import TypeVar

import zenoh

_Received = TypeVar("_Received")

_hold_state = ctypes.pythonapi.PyGILState_Ensure
_OF_THREAD = threading.local()  # is there as long as the state is


def on_network_thread(handler: Callable[[_Received], None]) -> "zenoh.handlers.Callback[_Received]":
    """Return a callback without a queue and a thread of its own; the handler keeps the network waiting.

    Python gives a thread that is none of its own a state when it calls in, and takes it away when it returns: the
    state's stack is mapped into memory and unmapped again for every call, which takes longer than most handlers. So
    the first call on a thread takes hold of the state once more than it is given up. It stays until the interpreter
    ends, even if the thread does not: Zenoh reads on a few threads, and seldom on a new one.
    """

    def on_thread(received: _Received) -> None:
        if not hasattr(_OF_THREAD, "held"):
            _OF_THREAD.held = True
            _hold_state()
        handler(received)

    return zenoh.handlers.Callback(on_thread, indirect=False)
