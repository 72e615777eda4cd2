"""A stream that stops in the middle until it may go on, for what is to happen while it is under way."""

import threading
from collections.abc import Iterator

from recorders.messages.record import RecordedMessage
from replay.transports.transport import Source

PATIENCE_S = 120.0


class HeldStream:
    """The stream of a source, held before one of its messages; its sender shows meanwhile that it lives.

    Attributes
    ----------
    reached : Event
        Set when all that comes before is sent.
    may_go_on : Event
        To be set by whoever holds it.
    """

    def __init__(self, source: Source, *, at: int) -> None:
        self._source = source
        self._at = at
        self.reached, self.may_go_on = threading.Event(), threading.Event()

    def stream(self, start: int) -> Iterator[RecordedMessage]:
        """Yield the stream from an index on."""
        for index, message in enumerate(self._source.stream(start), start):
            if index == self._at:
                self.reached.set()
                assert self.may_go_on.wait(PATIENCE_S)
            yield message
