"""Bounded queue of commands between Zenoh's threads and the robot's. No Zenoh."""

import queue
import threading
from typing import Generic, TypeVar

Event = TypeVar("Event")

MAX_WAITING = 1024
"""Commands and questions beyond this many are dropped: a flood must not fill the memory."""


class Inbox(Generic[Event]):
    """A queue that any thread may fill and one thread empties; it counts what it has no room for."""

    def __init__(self) -> None:
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._dropped = 0

    def put(self, event: Event) -> None:
        """Take in an event, or drop it if `MAX_WAITING` wait already."""
        with self._lock:
            if self._events.qsize() < MAX_WAITING:
                self._events.put(event)
            else:
                self._dropped += 1

    def get(self, timeout_s: float) -> Event | None:
        """Return the event that has waited longest; None if there is none within `timeout_s`."""
        try:
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def take_dropped(self) -> int:
        """Return how many events were dropped since this was last asked."""
        with self._lock:
            dropped, self._dropped = self._dropped, 0
        return dropped
