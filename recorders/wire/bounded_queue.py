"""A queue for arrived items that is full at so many bytes, and never makes the network wait."""

import threading
import time
from collections import deque
from typing import Generic, TypeVar

_Item = TypeVar("_Item")

ITEM_BYTES = 1024
"""Size that every item counts for beside its own, as Python needs some memory for it [bytes]."""

LONGEST_WAIT_S = 0.5
"""Longest single wait [s]: a signal that comes just before one begins does not end it."""


class BoundedQueue(Generic[_Item]):
    """A queue between the threads of the network, which put, and the one that takes.

    Python's own `queue.SimpleQueue` is none: before 3.13 its `get` forgets a timeout that passes while it looks whether
    there is an item, and waits for the next one, however long (`tests/recorders/wire/test_bounded_queue.py`).

    Parameters
    ----------
    limit : int
        How much may wait [bytes]; a single item may, however large.
    """

    def __init__(self, *, limit: int) -> None:
        self._limit = limit
        self._waiting = 0  # [bytes]
        self._dropped = 0
        self._lock = threading.Lock()
        self._items: deque[tuple[_Item, int]] = deque()
        self._nothing_new = threading.Lock()  # held from when the taker looks until the next item is put

    def put(self, item: _Item, size: int, *, always: bool = False) -> bool:
        """Queue an item of so many bytes; False if it finds no room, as one that is `always` to be queued does."""
        size += ITEM_BYTES
        with self._lock:
            if self._waiting and self._waiting + size > self._limit and not always:
                self._dropped += 1
                return False
            self._waiting += size
            self._items.append((item, size))
            if self._nothing_new.locked():
                self._nothing_new.release()
        return True

    def get(self, timeout_s: float) -> _Item | None:
        """Return the next item, or None if there is none within the time [s]."""
        deadline_s = time.monotonic() + timeout_s if timeout_s > 0 else 0.0
        while True:
            with self._lock:
                if self._items:
                    item, size = self._items.popleft()
                    self._waiting -= size
                    return item
            if timeout_s <= 0:
                return None
            left_s = max(0.0, deadline_s - time.monotonic())
            # A signal that comes just before a wait begins does not end it.
            if not self._nothing_new.acquire(timeout=min(left_s, LONGEST_WAIT_S)) and left_s <= LONGEST_WAIT_S:
                return None

    def take_dropped(self) -> int:
        """Return how many items found no room since this was last asked."""
        with self._lock:
            dropped, self._dropped = self._dropped, 0
        return dropped
