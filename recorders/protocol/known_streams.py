"""Streams that a receiver knows: the one under way, and those that are over, for senders that come back late."""

from dataclasses import replace
from typing import Any

from recorders.protocol.frames import NO_RUN, stream_of
from recorders.protocol.incoming import IncomingStream
from recorders.protocol.seals.sealing import ReceiverSeals
from recorders.protocol.stream import Offer, Progress

_MAX_PAST = 100
_MAX_OFFERED = 100


class KnownStreams:
    """The stream under way, and how others ended, by their senders, for as many as there is room.

    Attributes
    ----------
    current : IncomingStream, optional
        The stream under way.
    offered : dict of (bytes, bytes) to IncomingStream
        Streams on offer that the consumer has not decided on yet, by run and sender.
    """

    def __init__(self) -> None:
        self.current: IncomingStream | None = None
        self.offered: dict[tuple[bytes, bytes], IncomingStream] = {}
        self._ended: dict[str, Progress] = {}
        self._last = Progress()

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        current = self.current
        return self._last if current is None else current.progress

    @property
    def given_up(self) -> str:
        """Why the sender of the stream under way had given it up before it began; empty if it had not."""
        return "" if self.current is None else self.current.given_up

    def find(self, sender: str) -> Progress | None:
        """Return how far the stream of a sender is, or how it ended; None if there is none."""
        if self.current is not None and self.current.offer.sender == sender:
            return self.current.progress
        return self._ended.get(sender)

    def concerns(self, attachment: bytes) -> bool:
        """Whether an attachment is of the stream under way, of one on offer, or of one that is over."""
        found, current = stream_of(attachment), self.current
        if found is None:
            return False
        is_current = current is not None and found == current.identity
        return is_current or found in self.offered or found[1].hex() in self._ended

    def offer(self, offer: Offer, seals: ReceiverSeals) -> None:
        """Note an offer, on which the consumer is to decide; it may have come before."""
        self.offered.setdefault(offer.identity, IncomingStream(offer, seals, 0))
        _limit(self.offered, _MAX_OFFERED)

    def turn_down(self, offer: Offer, refusal: Progress) -> None:
        """Note that a stream on offer is refused."""
        self.offered.pop(offer.identity, None)
        self._end(offer.sender, refusal)

    def begin(self, stream: IncomingStream) -> None:
        """Note that a stream on offer is accepted."""
        known = self.offered.pop(stream.identity, stream)
        stream.given_up = known.given_up
        self.current = stream

    def close(self, reason: str) -> None:
        """Note that the stream under way is over; with a reason, if it has neither a result nor an error of its own."""
        if self.current is None:
            return
        progress, sender = self.current.progress, self.current.offer.sender
        self._last, self.current = progress, None
        if bytes.fromhex(sender) != NO_RUN:  # of those nobody is remembered by
            self._end(sender, progress if progress.is_final else replace(progress, error=reason))

    def _end(self, sender: str, progress: Progress) -> None:
        self._ended[sender] = progress
        _limit(self._ended, _MAX_PAST)


def _limit(streams: dict[Any, Any], most: int) -> None:
    """Forget the oldest of too many."""
    while len(streams) > most:
        del streams[next(iter(streams))]
