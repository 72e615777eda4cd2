"""The receiving machine: whatever is lost, repeated or late on the way, a stream comes out whole and in order."""

import math
import random
from dataclasses import replace
from typing import Any

import pytest
from sealed import Sealing, receiver

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.protocol.answers import Offered
from recorders.protocol.frames import NO_RUN, Frame, FrameType, pack
from recorders.protocol.incoming import MAX_REASON
from recorders.protocol.packets import Packet
from recorders.protocol.receiver import FAREWELL_WAIT_S, ReceiverMachine
from recorders.protocol.states import ReceiverState
from recorders.protocol.stream import WINDOW_BYTES, Offer, Progress, asking
from recorders.protocol.stream_digest import StreamDigests

OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8)
OTHER = replace(OFFER, sender="ef" * 16)
_SEALING: dict[str, Sealing] = {}


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


def frame(first: int, count: int = 1, *, kind: FrameType = FrameType.BATCH, offer: Offer = OFFER) -> Frame:
    return Frame(kind, *offer.identity, first, tuple(message(index) for index in range(first, first + count)))


def ended_by(frames: list[Frame]) -> Frame:
    """The end of a stream of these frames, as its sender digests them."""
    digests = StreamDigests()
    digests.begin("learner", 0)
    for each in frames:
        digests.add(each)
    return frame(frames[-1].end, 0, kind=FrameType.END)._replace(digests=digests.packed())


def sealing(offer: Offer) -> Sealing:
    """The one sender of an offer: its seals are counted through."""
    return _SEALING.setdefault(offer.sender, Sealing(offer))


def hello(machine: ReceiverMachine, offer: Offer = OFFER) -> Packet | Offered:
    return sealing(offer).hello(machine)


def read(packet: Packet | Offered | None) -> Progress:
    assert isinstance(packet, Packet)
    return Progress.from_json(packet.payload)


def take(machine: ReceiverMachine, sent: Frame, now_s: float = 0.0) -> Frame | None:
    offer = OFFER if sent.sender == OFFER.identity[1] else OTHER
    return machine.on_sample(*sealing(offer).frame(sent), now_s)


def ask(machine: ReceiverMachine, asked: bytes, now_s: float = 0.0) -> Progress:
    offer = OTHER if asked in (asking(OTHER), asking(OTHER, farewell=True)) else OFFER
    question = sealing(offer).question("status", asked)
    answer = machine.on_status(question)
    machine.on_status_answered(question, answer, now_s)
    return read(answer)


def accepted(start: int = 0, offer: Offer = OFFER) -> ReceiverMachine:
    machine = receiver()
    offered = hello(machine, offer)
    assert isinstance(offered, Offered)
    assert read(machine.accept(offered, start, 0.0)) == Progress(run=offer.run, next=start, received=start)
    return machine


@pytest.mark.parametrize("seed", range(20))
def test_frames_that_are_lost_repeated_and_late_come_out_in_order_and_once(seed: int) -> None:
    draw = random.Random(seed)
    sent = [frame(first, min(3, 200 - first)) for first in range(0, 200, 3)]
    sent.append(ended_by(sent))
    machine, ended = accepted(), 0
    taken: list[Any] = []
    while not ended:
        lacking = [each for each in sent if each.end > machine.progress.received or each.kind is FrameType.END]
        under_way = [each for each in lacking[:8] if draw.random() < 0.7] + draw.choices(sent, k=2)
        draw.shuffle(under_way)
        for each in under_way:
            new = take(machine, each)
            if new is None or draw.random() < 0.1:  # the queue is full
                continue
            machine.arrived(new)
            taken += new.messages
            ended += new.kind is FrameType.END
    assert taken == [message(index) for index in range(200)]
    assert ended == 1
    assert machine.progress == Progress(run=OFFER.run, next=0, received=200)
    assert take(machine, sent[-1]) is None


def test_half_a_window_or_a_quarter_of_the_bytes_is_acknowledged() -> None:
    machine = accepted(start=100)
    due = []
    for index in range(100, 110):
        machine.arrived(frame(index))
        due.append(machine.consume(frame(index)) is not None)
    assert due == [False, False, False, True] * 2 + [False, False]
    large = frame(110)._replace(messages=(message(110)._replace(data=bytes(WINDOW_BYTES // 4)),))
    machine.arrived(large)
    assert read(machine.consume(large)).next == 111


@pytest.mark.parametrize(("window", "every"), [(1, 1), (2, 1), (3, 1), (4, 2), (9, 4)])
def test_every_half_of_a_window_is_acknowledged(window: int, every: int) -> None:
    machine = accepted(offer=replace(OFFER, sender=f"{window:032x}", window=window))
    for index in range(9):
        machine.arrived(frame(index))
        assert (machine.consume(frame(index)) is not None) == ((index + 1) % every == 0)


def test_every_quarter_of_the_bytes_is_acknowledged() -> None:
    machine = accepted(offer=replace(OFFER, sender="9" * 32, window=1000))
    sizes = [WINDOW_BYTES // 4 - 1, 1, WINDOW_BYTES // 4 - 1, 0, 1, WINDOW_BYTES // 4]
    data = bytes(WINDOW_BYTES // 4)
    due = []
    for index, size in enumerate(sizes):
        large = frame(index)._replace(messages=(message(index)._replace(data=data[:size]),))
        machine.arrived(large)
        due.append(machine.consume(large) is not None)
    assert due == [False, True, False, False, True, True]


def test_what_was_looked_at_is_digested_only_if_it_is_queued() -> None:
    machine = accepted()
    first, longer = take(machine, frame(0, 2)), take(machine, frame(0, 3))
    assert first is not None
    assert longer is not None
    machine.arrived(first)  # and the other one found the queue full
    again = take(machine, frame(0, 3))
    assert again is not None
    assert again.messages == (message(2),)
    machine.arrived(again)
    machine.finish({}, 0.0)
    digests = StreamDigests()
    digests.begin("learner", 0)
    digests.add(frame(0, 3))
    assert machine.progress.digest == digests.digest("learner")


def test_a_machine_without_a_stream_knows_nothing_and_waits_for_nobody() -> None:
    machine = receiver()
    assert (machine.progress, machine.offer, machine.released) == (Progress(), None, True)
    assert machine.deadline_s == math.inf
    assert machine.on_time(1e9) is None
    offered = hello(machine)
    assert isinstance(offered, Offered)
    assert offered.size == len(OFFER.to_json())
    machine.accept(offered, 0, 50.0)
    assert machine.offer == OFFER
    assert machine.deadline_s == 80.0


def test_a_stream_that_is_through_is_not_begun_again_and_acknowledges_nothing() -> None:
    for conclude in ("finish", "fail"):
        machine = accepted()
        machine.arrived(frame(0, 8))
        machine.finish({"count": 8}, 0.0) if conclude == "finish" else machine.fail("full", 0.0)
        assert machine.consume(frame(0, 8)) is None
        answer = read(hello(machine))
        assert (answer.result, answer.error) == (({"count": 8}, None) if conclude == "finish" else (None, "full"))


def test_the_ends_of_a_hundred_streams_are_known() -> None:
    machine = receiver()
    offers = [replace(OFFER, sender=f"{number:032x}") for number in range(1000, 1101)]
    for offer in offers:
        offered = hello(machine, offer)
        assert isinstance(offered, Offered)
        machine.accept(offered, 0, 0.0)
        attachment = sealing(offer).frame(frame(0, offer=offer))[1].attachment
        assert machine.concerns(attachment)
        assert not machine.concerns(sealing(OFFER).frame(frame(0))[1].attachment)
        machine.abandon(offer.sender)
        assert machine.concerns(attachment)
    assert isinstance(hello(machine, offers[0]), Offered)
    for offer in offers[1:]:
        assert read(hello(machine, offer)).error == offer.sender


def test_an_offer_to_an_instance_that_is_no_more_is_to_be_made_again() -> None:
    machine = receiver()
    first, other = hello(machine), hello(machine, OTHER)
    assert isinstance(first, Offered)
    assert isinstance(other, Offered)
    machine.accept(other, 0, 0.0)
    machine.abandon()
    assert read(machine.answer(first)) == Progress()


def test_a_hundred_offers_wait_and_no_more() -> None:
    machine = receiver()
    offers = [replace(OFFER, sender=f"{number:032x}") for number in range(2000, 2101)]
    for offer in offers:
        offered = hello(machine, offer)
        assert isinstance(offered, Offered)
        machine.waiting(offered)
    known = [machine.concerns(sealing(offer).frame(frame(0, offer=offer))[1].attachment) for offer in offers]
    assert known == [False, *[True] * 100]


def test_a_consumer_stays_the_instance_that_a_stream_under_way_or_on_offer_knows() -> None:
    machine = receiver()
    first, other = hello(machine), hello(machine, OTHER)
    assert isinstance(first, Offered)
    assert isinstance(other, Offered)
    for offered in (first, other):
        machine.waiting(offered)
    assert read(machine.refuse(first, "no")).error == "no"
    assert isinstance(machine.on_hello(other.question), Offered)
    machine.accept(other, 0, 0.0)
    assert read(hello(machine)).error == "no"
    assert read(hello(machine, replace(OFFER, sender="12" * 16))).error == machine.taken
    assert read(machine.on_hello(other.question)) == Progress(OTHER.run)
    machine.abandon()
    assert read(machine.on_hello(other.question)) == Progress()  # it is to be offered to the next instance


def test_offers_are_answered_by_what_the_stream_is() -> None:
    machine = accepted(start=7)
    assert read(hello(machine)) == machine.progress
    assert read(hello(machine, OTHER)) == Progress(error="learner is already fed by another replay")
    machine.abandon("no more")
    assert machine.state is ReceiverState.IDLE
    assert read(hello(machine)) == Progress(run=OFFER.run, next=7, received=7, error="no more")
    assert take(machine, frame(7)) is None
    assert machine.concerns(sealing(OFFER).frame(frame(7))[1].attachment)
    assert not machine.concerns(sealing(OTHER).frame(frame(7, offer=OTHER))[1].attachment)
    offered = hello(machine, OTHER)
    assert isinstance(offered, Offered)
    machine.waiting(offered)
    assert machine.concerns(sealing(OTHER).frame(frame(7, offer=OTHER))[1].attachment)


def test_an_offer_that_is_repeated_while_the_consumer_decides_is_answered_like_the_first() -> None:
    machine = receiver()
    first, again = hello(machine), hello(machine)
    assert isinstance(first, Offered)
    assert isinstance(again, Offered)
    assert machine.answer(again) is None
    machine.accept(first, 5, 0.0)
    assert read(machine.answer(again)).next == 5


def test_a_sender_that_gives_up_before_the_consumer_has_decided_is_not_awaited() -> None:
    machine = receiver()
    offered = hello(machine)
    assert isinstance(offered, Offered)
    machine.waiting(offered)
    abort = frame(0, 0, kind=FrameType.ABORT)._replace(reason="no log")
    topic, packet = sealing(OFFER).frame(abort)
    with pytest.raises(MessageError, match="not sealed by its sender"):
        machine.on_sample(topic, packet._replace(payload=b"forged"), 0.5)
    assert take(machine, abort, 1.0) is None
    machine.accept(offered, 0, 2.0)
    assert machine.deadline_s <= 2.0
    assert str(machine.on_time(2.0)) == "the sender gave up at message 0: no log"
    assert machine.state is ReceiverState.LOST
    machine.abandon()
    assert isinstance(hello(machine, OTHER), Offered)


@pytest.mark.parametrize("under_way", [False, True])
def test_an_offer_that_was_turned_down_is_not_taken_when_it_is_made_again(under_way: bool) -> None:
    """By whoever overheard it: it would keep the consumer waiting for a sender that is gone."""
    machine = receiver()
    overheard = hello(machine, OTHER)
    assert isinstance(overheard, Offered)
    machine.waiting(overheard)
    if under_way:
        first = hello(machine)
        assert isinstance(first, Offered)
        machine.accept(first, 0, 0.0)
        assert read(machine.answer(overheard)) == Progress(error="learner is already fed by another replay")
        machine.abandon()
    else:
        assert read(machine.refuse(overheard, "another robot")) == Progress(error="another robot")
    assert read(machine.on_hello(overheard.question)) == Progress()
    later = hello(machine, OTHER)
    assert isinstance(later, Offered) if under_way else read(later) == Progress(error="another robot")


def test_an_offer_that_is_repeated_is_answered_by_where_its_stream_began() -> None:
    machine = accepted(start=7)
    machine.arrived(frame(7))
    machine.consume(frame(7))
    assert machine.progress.next == 8
    assert read(hello(machine)) == Progress(run=OFFER.run, next=7, received=7)  # where its digest began


def test_live_messages_are_of_no_sender_that_could_be_left() -> None:
    machine = accepted(offer=replace(OFFER, sender=NO_RUN.hex()))
    machine.abandon()
    packet = Packet(*pack(Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (message(0),))))
    assert not machine.concerns(packet.attachment)


def test_a_result_is_kept_until_the_farewell_of_its_sender() -> None:
    machine = accepted()
    machine.finish({"count": 3}, 1.0)
    for asked in (asking(OFFER), asking(OTHER, farewell=True), b"\xff", asking(OFFER, farewell=True)):
        assert machine.state is ReceiverState.REPORTED
        assert not machine.released
        answer = ask(machine, asked, 2.0)
        assert answer.result == (None if asked == asking(OTHER, farewell=True) else {"count": 3})
    assert machine.released
    assert machine.offer is None
    assert ask(machine, asking(OFFER)).result == {"count": 3}


def test_a_failure_is_over_as_soon_as_its_sender_knows() -> None:
    machine = accepted()
    question = sealing(OFFER).question("status", asking(OFFER))
    before = machine.on_status(question)
    machine.fail("the disk is full", 0.0)
    machine.on_status_answered(question, before, 0.0)  # it does not know yet
    assert machine.state is ReceiverState.FAILED
    assert not machine.released
    assert ask(machine, asking(OFFER)).error == "the disk is full"
    assert machine.released


def test_an_end_of_another_stream_than_arrived_is_a_failure_that_both_ends_learn() -> None:
    machine = accepted()
    for first in (0, 1):
        new = take(machine, frame(first))
        assert new is not None
        machine.arrived(new)
    other = take(machine, ended_by([frame(0), frame(1)._replace(messages=(message(7),))]))
    assert other is not None
    assert other.kind is FrameType.ABORT
    assert other.reason == "what arrived up to message 2 is not what was sent: nothing of it is to be trusted"
    machine.arrived(other)
    assert machine.state is ReceiverState.FAILED
    assert not machine.released
    assert ask(machine, asking(OFFER)).error == other.reason


@pytest.mark.parametrize("conclude", ["finish", "fail"])
def test_a_sender_that_never_asks_is_left_and_informed_if_it_comes_back(conclude: str) -> None:
    machine = accepted()
    machine.finish({}, 10.0) if conclude == "finish" else machine.fail("full", 10.0)
    assert machine.deadline_s == 10.0 + FAREWELL_WAIT_S
    assert machine.on_time(14.0) is None
    assert not machine.released
    assert machine.on_time(machine.deadline_s) is None
    assert machine.state is ReceiverState.IDLE
    assert ask(machine, asking(OFFER)).is_final


def test_an_abort_counts_unless_the_stream_is_through() -> None:
    abort = frame(0, 0, kind=FrameType.ABORT)._replace(reason="\x1b[2J" + "a" * 2 * MAX_REASON)
    machine = accepted()
    taken = take(machine, abort)
    assert taken is not None
    assert taken.reason.isprintable()
    assert len(taken.reason) < MAX_REASON + 100
    machine.arrived(taken)
    assert machine.state is ReceiverState.LOST
    assert take(machine, frame(0)) is None
    assert taken.reason.startswith("the sender gave up at message 0: ")
    machine.fail("the sender gave up", 0.0)
    assert isinstance(hello(machine, OTHER), Offered)
    through = accepted()
    through.finish({}, 0.0)
    assert take(through, abort) is None
    assert through.released
    assert ask(through, asking(OFFER)).result == {}


def test_silence_ends_a_stream_that_is_under_way_and_no_other() -> None:
    machine = accepted()
    take(machine, frame(0), 10.0)
    assert machine.deadline_s == 40.0
    assert machine.on_time(39.0) is None
    assert "fell silent 31 s ago, before message 0" in str(machine.on_time(41.0))
    assert machine.state is ReceiverState.LOST
    assert machine.released
    living = accepted()
    ask(living, asking(OTHER), 20.0)  # of somebody else
    assert living.deadline_s == 30.0
    ask(living, asking(OFFER), 20.0)
    assert living.deadline_s == 50.0
    living.finish({}, 0.0)
    assert living.on_time(1_000.0) is None
