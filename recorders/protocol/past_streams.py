"""Streams that a receiver is through with, kept for senders that come back late."""

from dataclasses import replace

from recorders.protocol.frames import NO_RUN
from recorders.protocol.stream import Offer, Progress

_MAX_STREAMS = 100


class PastStreams:
    """How streams ended, by their senders, for as many as there is room."""

    def __init__(self) -> None:
        self._ended: dict[str, Progress] = {}

    def keep(self, offer: Offer, progress: Progress, reason: str) -> None:
        """Keep how a stream ended; with a reason, if it has neither a result nor an error of its own."""
        if bytes.fromhex(offer.sender) == NO_RUN:  # live messages are of no sender
            return
        self._ended[offer.sender] = progress if progress.is_final else replace(progress, error=reason)
        while len(self._ended) > _MAX_STREAMS:
            del self._ended[next(iter(self._ended))]

    def find(self, sender: str) -> Progress | None:
        """Return how the stream of a sender ended; None if there was none."""
        return self._ended.get(sender)
