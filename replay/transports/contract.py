"""Tests that every transport and every clock passes; needs pytest, and a test class of one's own that makes one."""

from collections.abc import Iterator
from typing import Any

import pytest

from recorders.errors import LogError, MessageError, ReenactError
from recorders.messages.message_types import String
from recorders.messages.record import RecordedMessage
from recorders.protocol.stream import Consumer, Offer
from replay.transports.clock import Clock, paced
from replay.transports.transport import StreamFrom

_COUNT = 500
_OFFER = Offer(run="ab" * 16, schedule={}, logs=[])


def message(index: int) -> RecordedMessage:
    """Return a message of the stream; its time falls now and then, as where a cycle begins anew."""
    return RecordedMessage("/note", String.TYPE, f"payload {index}".encode() * (index % 7), index, index % 100)


def stream_from(start: int) -> Iterator[RecordedMessage]:
    """Yield the stream from an index on."""
    return (message(index) for index in range(start, _COUNT))


class Listing:
    """A consumer that keeps what it is fed, wants to begin at `start`, and may refuse, or fail at a message."""

    def __init__(self, *, start: int = 0, refusal: str = "", fail_at: int = -1) -> None:
        self._start, self._refusal, self._fail_at = start, refusal, fail_at
        self.messages: list[RecordedMessage] = []

    def hello(self, offer: Offer) -> int:
        """Want the stream from `start` on, or refuse it."""
        if self._refusal:
            raise MessageError(self._refusal)
        return self._start

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        """Keep the messages, and count them."""
        for found in messages:
            if found.sequence == self._fail_at:
                raise MessageError(f"message {self._fail_at} is not wanted")
            self.messages.append(found)
        return {"count": len(self.messages)}


class TransportContract:
    """Tests of a transport, for a class that inherits them: all of the stream, in order, or an error."""

    def deliver(self, consumer: Consumer, offer: Offer, stream_from: StreamFrom) -> dict[str, Any]:
        """Deliver a stream to one consumer, wherever it is, and return its result."""
        raise NotImplementedError

    @pytest.mark.parametrize("start", [0, 123, _COUNT])
    def test_everything_arrives_once_and_in_order(self, start: int) -> None:
        """From where the consumer wants it, every field as it was; the result comes back."""
        consumer = Listing(start=start)
        assert self.deliver(consumer, _OFFER, stream_from) == {"count": _COUNT - start}
        assert consumer.messages == list(stream_from(start))

    def test_a_refused_offer_says_why(self) -> None:
        """In the consumer's words."""
        with pytest.raises(ReenactError, match="another robot"):
            self.deliver(Listing(refusal="another robot"), _OFFER, stream_from)

    def test_a_consumer_that_fails_is_an_error_with_its_reason(self) -> None:
        """What was consumed before is what came before."""
        consumer = Listing(fail_at=77)
        with pytest.raises(ReenactError, match="message 77 is not wanted"):
            self.deliver(consumer, _OFFER, stream_from)
        assert consumer.messages == list(stream_from(0))[:77]

    def test_a_stream_that_fails_is_never_taken_for_a_short_one(self) -> None:
        """Its own error comes out."""

        def broken(start: int) -> Iterator[RecordedMessage]:
            for index in range(start, 50):
                yield message(index)
            raise LogError("cut off at byte 12345")

        with pytest.raises(LogError, match="cut off"):
            self.deliver(Listing(), _OFFER, broken)


class ClockContract:
    """Tests of a clock, for a class that inherits them: whatever the times of a stream, it goes on unchanged.

    No time is asserted: how long a clock waits is its own.
    """

    def clock(self) -> Clock:
        """Make a clock."""
        raise NotImplementedError

    @pytest.mark.parametrize(
        "times_ns", [[], [0], [5] * 4, [0, 1_000, 2_000, 0, 1_000], [2**62, 0, 1], [10**18, 10**18 + 1]]
    )
    def test_a_stream_goes_on_unchanged(self, times_ns: list[int]) -> None:
        """Times that stay, fall or are large hold nothing up."""
        records = [message(index)._replace(log_time_ns=time_ns) for index, time_ns in enumerate(times_ns)]
        assert list(paced(iter(records), self.clock())) == records

    def test_a_message_is_taken_only_when_the_one_before_has_passed(self) -> None:
        """A clock looks at no message ahead of the one that is due."""
        taken: list[int] = []

        def noted() -> Iterator[RecordedMessage]:
            for index in range(3):
                taken.append(index)
                yield message(index)

        for index, _ in enumerate(paced(noted(), self.clock())):
            assert taken == list(range(index + 1))

    def test_a_pause_that_was_asked_for_is_taken_note_of(self) -> None:
        """At any time, the first message's included."""
        clock = self.clock()
        for pause_ns in (0, 1, 1_000):
            clock.delay(pause_ns)
            clock.wait(0)
