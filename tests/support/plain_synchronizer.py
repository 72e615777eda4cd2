"""Synchronizers as message_filters has them: messages of several topics, called back together by their stamps."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any


class TimeSynchronizer:
    """Calls back with one message of each topic as soon as all have one of the same stamp.

    Parameters
    ----------
    topics : sequence of str
        The topics, in the order of the callback's arguments.
    queue_size : int
        Messages of a topic that wait; the oldest is dropped first.
    called : callable
        Given the messages.
    """

    def __init__(self, topics: Sequence[str], queue_size: int, called: Callable[..., None]) -> None:
        self.queues: dict[str, dict[int, Any]] = {topic: {} for topic in topics}
        self.queue_size, self.called = queue_size, called

    def add(self, topic: str, stamp: int, message: Any) -> None:
        """Take a message."""
        queue = self.queues[topic]
        queue[stamp] = message
        while len(queue) > self.queue_size:
            del queue[min(queue)]
        for common in sorted(set.intersection(*(set(waiting) for waiting in self.queues.values()))):
            self.called(*(waiting.pop(common) for waiting in self.queues.values()))


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """The same for stamps that lie within `slop`: of all sets that can be made, the one that lies closest is first."""

    def __init__(self, topics: Sequence[str], queue_size: int, slop: int, called: Callable[..., None]) -> None:
        super().__init__(topics, queue_size, called)
        self.slop = slop

    def add(self, topic: str, stamp: int, message: Any) -> None:
        """Take a message."""
        queue = self.queues[topic]
        queue[stamp] = message
        while len(queue) > self.queue_size:
            del queue[min(queue)]
        others = [
            [(abs(at - stamp), at) for at in (waiting if waiting is not queue else [stamp])]
            for waiting in self.queues.values()
        ]
        sets = sorted(product(*others), key=lambda found: [distance for distance, _ in found])
        for found in sets:
            stamps = [at for _, at in found]
            waits = all(at in waiting for at, waiting in zip(stamps, self.queues.values(), strict=True))
            if waits and max(stamps) - min(stamps) < self.slop:
                self.called(*(waiting.pop(at) for at, waiting in zip(stamps, self.queues.values(), strict=True)))
                return
