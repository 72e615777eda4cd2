"""State of a received stream: whatever is lost, repeated or late on the way, it comes out whole and in order."""

import random
from dataclasses import replace
from typing import Any

import pytest

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.wire.frames import NO_RUN, Frame, FrameType
from recorders.wire.received_stream import MAX_REASON, ReceivedStream
from recorders.wire.stream import WINDOW_BYTES, Offer, Progress, asking

OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8)
OTHER = replace(OFFER, sender="ef" * 16)


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


def frame(first: int, count: int = 1, *, kind: FrameType = FrameType.BATCH, offer: Offer = OFFER) -> Frame:
    return Frame(kind, *offer.identity, first, tuple(message(index) for index in range(first, first + count)))


def accepted(start: int = 0) -> ReceivedStream:
    stream = ReceivedStream("learner", silence_s=30.0)
    assert stream.answer_hello(OFFER) is None
    assert stream.accept(OFFER, start, 0.0) == Progress(run=OFFER.run, next=start, received=start)
    return stream


@pytest.mark.parametrize("seed", range(20))
def test_frames_that_are_lost_repeated_and_late_come_out_in_order_and_once(seed: int) -> None:
    draw = random.Random(seed)
    sent = [frame(first, min(3, 200 - first)) for first in range(0, 200, 3)] + [frame(200, 0, kind=FrameType.END)]
    stream, ended = accepted(), False
    taken: list[Any] = []
    while not ended:
        lacking = [each for each in sent if each.end > stream.progress.received or each.kind is FrameType.END]
        under_way = [each for each in lacking[:8] if draw.random() < 0.7] + draw.choices(sent, k=2)
        draw.shuffle(under_way)
        for each in under_way:
            new = stream.take(each, 0.0)
            if new is None or draw.random() < 0.1:  # the queue is full
                continue
            stream.arrived(new)
            taken += new.messages
            ended = ended or new.kind is FrameType.END
    assert taken == [message(index) for index in range(200)]
    assert stream.progress == Progress(run=OFFER.run, next=0, received=200)


def test_half_a_window_or_a_quarter_of_the_bytes_is_acknowledged() -> None:
    stream = accepted(start=100)
    due = [stream.consume(frame(index)) for index in range(100, 110)]
    assert due == [False, False, False, True] * 2 + [False, False]
    large = message(110)._replace(data=bytes(WINDOW_BYTES // 4))
    assert stream.consume(frame(110)._replace(messages=(large,)))
    assert stream.progress.next == 111


def test_offers_are_answered_by_what_the_stream_is() -> None:
    stream = accepted(start=7)
    assert stream.answer_hello(OFFER) == stream.progress
    assert stream.answer_hello(OTHER) == Progress(error="learner is already fed by another replay")
    stream.abandon("no more")
    assert stream.answer_hello(OFFER) == Progress(run=OFFER.run, next=7, received=7, error="no more")
    assert stream.answer_hello(OTHER) is None
    assert not stream.owns(frame(7))
    assert stream.has_left(frame(7))
    assert not stream.has_left(frame(7, offer=OTHER))


def test_live_messages_are_of_no_sender_that_could_be_left() -> None:
    stream = ReceivedStream("learner", silence_s=30.0)
    stream.accept(replace(OFFER, sender=NO_RUN.hex()), 0, 0.0)
    stream.abandon()
    assert not stream.has_left(Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (message(0),)))


def test_a_result_is_kept_until_the_farewell_of_its_sender() -> None:
    stream = accepted()
    stream.finish({"count": 3}, 1.0)
    for asked in (asking(OFFER), asking(OTHER, farewell=True), b"\xff", asking(OFFER, farewell=True)):
        assert not stream.released
        answer = stream.answer_status(asked)
        assert answer.result == {"count": 3}
        stream.note_status(asked, answer, 2.0)
    assert stream.released
    assert stream.offer is None
    assert stream.answer_status(asking(OFFER)).result == {"count": 3}


def test_a_failure_is_over_as_soon_as_its_sender_knows() -> None:
    stream = accepted()
    stream.fail("the disk is full")
    answer = stream.answer_status(asking(OFFER))
    assert answer.error == "the disk is full"
    stream.note_status(asking(OFFER), answer, 1.0)
    assert stream.released


def test_an_abort_counts_unless_the_stream_is_through() -> None:
    abort = frame(0, 0, kind=FrameType.ABORT)._replace(reason="\x1b[2J" + "a" * 2 * MAX_REASON)
    stream = accepted()
    taken = stream.take(abort, 0.0)
    assert taken is not None
    assert taken.reason.isprintable()
    assert len(taken.reason) < MAX_REASON + 10
    assert str(stream.gave_up(taken)).startswith("the sender gave up at message 0: ")
    through = accepted()
    through.finish({}, 0.0)
    assert through.take(abort, 0.0) is None
    assert through.released
    assert through.answer_status(asking(OFFER)).result == {}


def test_silence_ends_a_stream_that_is_under_way_and_no_other() -> None:
    stream = accepted()
    stream.take(frame(0), 10.0)
    stream.check_silence(40.0)
    with pytest.raises(WireError, match="fell silent 31 s ago, before message 0"):
        stream.check_silence(41.0)
    assert stream.released
    stream.note_status(asking(OTHER), stream.progress, 41.0)  # of somebody else
    assert stream.silence_s(41.0) == 31.0
    stream.note_status(asking(OFFER), stream.progress, 41.0)
    stream.check_silence(71.0)
    stream.finish({}, 0.0)
    stream.check_silence(1_000.0)
