"""The transport protocol: how an ordered stream reaches its consumers. In-process here, Zenoh in its own module."""

from collections.abc import Callable, Iterator
from typing import Any, Protocol

from recorders.messages.record import RecordedMessage
from recorders.protocol.stream import Consumer, Offer

StreamFrom = Callable[[int], Iterator[RecordedMessage]]
"""Gives the stream from an index on; index 0 is the first message of the run."""


class Source(Protocol):
    """A stream that can be offered: a schedule over logs, a recorded session, a plain playback."""

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages from index `start` on."""


class Transport(Protocol):
    """Delivers a stream to one consumer or more, in order, without loss, or raises."""

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream from where the consumers want it, and return their results by name.

        Raises
        ------
        WireError
            If a consumer is not there, refuses the offer or stops answering.
        ReenactError
            If the stream itself fails; the consumers are informed.
        """


class InProcess:
    """Hands the stream to consumers of this process, one after the other, as fast as they take it.

    Parameters
    ----------
    consumers : dict of str to Consumer
        The consumers by name.
    """

    def __init__(self, consumers: dict[str, Consumer]) -> None:
        self._consumers = dict(consumers)

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream; see `Transport.deliver`."""
        return {
            name: consumer.consume(stream_from(consumer.hello(offer))) for name, consumer in self._consumers.items()
        }
