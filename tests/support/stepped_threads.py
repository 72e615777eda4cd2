"""The periodic threads of the log writer, stepped by hand: what they do, and nothing of when."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

import pytest


class SteppedThreads:
    """Takes the place of `PeriodicThread`, and holds what the latest log's threads do."""

    def __init__(self) -> None:
        self._actions: dict[str, Callable[[], None]] = {}

    def step(self, name: str) -> None:
        """Have a thread do once what it does."""
        self._actions[name]()

    def made(self, action: Callable[[], None], *, name: str, every_s: float) -> Self:
        """Stand in the place of a thread."""
        self._actions[name] = action
        return self

    def start(self) -> None:
        """Nothing runs."""

    def stop(self) -> None:
        """Nothing runs."""


@contextmanager
def stepped_threads() -> Iterator[SteppedThreads]:
    """Have the threads of all log writers stepped by hand; what waits at two steps of `log flush` is handed over."""
    threads = SteppedThreads()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("recorders.writing.log_file.PeriodicThread", threads.made)
        yield threads
