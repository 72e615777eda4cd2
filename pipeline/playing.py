"""What stands between a stream and the wire in a replay: the comparison with a recorded run, and the keyboard."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from recorders.reader import LogReader
from recorders.records import Stamped
from recorders.stream import Offer
from recorders.topics import LEARNER_TOPICS, SESSION_PHASE
from replay.clock import Pausable
from replay.compare import guard
from replay.transport import Source

_SESSION_TOPICS = frozenset({SESSION_PHASE, *(topic.name for topic in LEARNER_TOPICS)})


class Guarded:
    """A stream that stops at the first message in which it parts from a recorded run.

    Parameters
    ----------
    source : Source
        The stream.
    against : Path
        Log of the run to compare with.
    everything : bool
        Whether all its topics are compared, or only the learner's and the phase markers.
    """

    def __init__(self, source: Source, against: Path, *, everything: bool) -> None:
        self._source = source
        self._recorded = LogReader(against)
        self._topics = None if everything else _SESSION_TOPICS

    def offer(self) -> Offer:
        """Return the offer of the stream itself."""
        return self._source.offer()

    def stream(self, start: int = 0) -> Iterator[Stamped]:
        """Yield the messages from index `start` on; those before are compared too.

        Raises
        ------
        CheckFailed
            At the message in which the stream and the recorded run part.
        """
        agreed = guard(self._source.stream(), self._recorded.records(topics=self._topics))
        for index, message in enumerate(agreed):
            if index >= start:
                yield message


@contextmanager
def keyboard(clock: Pausable, *, enabled: bool) -> Iterator[None]:
    """While the block runs, let the space bar stop and start the clock, and a full stop let one message pass."""
    if enabled:
        threading.Thread(target=_obey, args=(clock,), daemon=True).start()
    yield


def _obey(clock: Pausable) -> None:
    while True:
        try:
            key = typer.getchar()
        except (EOFError, KeyboardInterrupt, OSError):
            return
        if key == " ":
            clock.toggle()
        elif key == ".":
            clock.step()
