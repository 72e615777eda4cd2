"""Streams that a receiver knows: the one under way, and those that are over, for senders that come back late."""

from dataclasses import replace

from recorders.protocol.frames import NO_RUN, stream_of
from recorders.protocol.incoming import IncomingStream
from recorders.protocol.stream import Progress

_MAX_PAST = 100


class KnownStreams:
    """The stream under way, and how others ended, by their senders, for as many as there is room.

    Attributes
    ----------
    current : IncomingStream, optional
        The stream under way.
    """

    def __init__(self) -> None:
        self.current: IncomingStream | None = None
        self._ended: dict[str, Progress] = {}
        self._last = Progress()

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        current = self.current
        return self._last if current is None else current.progress

    def find(self, sender: str) -> Progress | None:
        """Return how far the stream of a sender is, or how it ended; None if there is none."""
        if self.current is not None and self.current.offer.sender == sender:
            return self.current.progress
        return self._ended.get(sender)

    def concerns(self, attachment: bytes) -> bool:
        """Whether an attachment is of the stream under way, or of one that is over."""
        found, current = stream_of(attachment), self.current
        if found is None:
            return False
        return (current is not None and found == current.identity) or found[1].hex() in self._ended

    def close(self, reason: str) -> None:
        """Note that the stream under way is over; with a reason, if it has neither a result nor an error of its own."""
        if self.current is None:
            return
        progress, sender = self.current.progress, self.current.offer.sender
        self._last, self.current = progress, None
        if bytes.fromhex(sender) != NO_RUN:  # live messages are of no sender
            self._ended[sender] = progress if progress.is_final else replace(progress, error=reason)
        while len(self._ended) > _MAX_PAST:
            del self._ended[next(iter(self._ended))]
