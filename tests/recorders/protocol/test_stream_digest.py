"""Digests of a stream: of its messages as batches carry them, however they are cut, and of nothing else."""

import hashlib

import pytest
from sealed import Sealing, receiver

from recorders.messages.record import RecordedMessage
from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType, records
from recorders.protocol.stream import Offer
from recorders.protocol.stream_digest import StreamDigest, StreamDigests

RUN, SENDER = bytes(16), bytes(range(16))
START = 5
CLOCK = "rosgraph_msgs/msg/Clock"
BEFORE = RecordedMessage("/clock", CLOCK, b"before", 0, 1)
MESSAGES = (
    RecordedMessage("/clock", CLOCK, b"a", 1, 2),
    RecordedMessage("/x", "pkg/msg/X", b"b", 2, 3),
    RecordedMessage("/clock", CLOCK, b"", 3, 4),
)
EXPECTED = hashlib.sha256(records(MESSAGES)).digest()


def batch(first: int, messages: tuple[RecordedMessage, ...]) -> Frame:
    return Frame(FrameType.BATCH, RUN, SENDER, first, messages)


def singles(*messages: RecordedMessage) -> list[Frame]:
    return [Frame(FrameType.MESSAGE, RUN, SENDER, START + place, (message,)) for place, message in enumerate(messages)]


CUT = {
    "whole": [batch(START, MESSAGES)],
    "one by one": singles(*MESSAGES),
    "repeated": [batch(START, MESSAGES[:2]), batch(START, MESSAGES[:2]), batch(START + 1, MESSAGES[1:])],
    "with what came before": [batch(START - 1, (BEFORE, *MESSAGES[:1])), batch(START + 1, MESSAGES[1:])],
    "with a gap": [batch(START + 2, MESSAGES[2:]), batch(START - 1, (BEFORE,)), batch(START, MESSAGES)],
    "with its end": [batch(START, MESSAGES), Frame(FrameType.END, RUN, SENDER, START + 3)],
    "of another type than its topic's": singles(MESSAGES[0]._replace(type="pkg/msg/X"), *MESSAGES[1:]),
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", CUT)
def test_however_a_stream_is_cut_its_digest_is_that_of_one_batch(name: str, packed: bool) -> None:
    digest = StreamDigest(START)
    for frame in CUT[name]:
        given = records(frame.messages) if packed and frame.kind is FrameType.BATCH else b""
        digest.add(frame, given)
    assert digest.digest() == EXPECTED
    assert digest.at == START + 3


def test_the_type_of_a_message_in_a_batch_counts_for_itself() -> None:
    other = (MESSAGES[0]._replace(type="pkg/msg/X"), *MESSAGES[1:])
    digest = StreamDigest(START)
    digest.add(batch(START, other))
    assert digest.digest() == hashlib.sha256(records(other)).digest() != EXPECTED


@pytest.mark.parametrize("size", [0, 2_000, 2_047, 4_094, 65_480, 65_536, 200_000])
def test_messages_of_any_size_are_in_it(size: int) -> None:
    messages = (RecordedMessage("/clock", CLOCK, bytes(place % 251 for place in range(size)), 1, 2), BEFORE)
    digest = StreamDigest(START)
    for place, message in enumerate(messages):
        digest.add(batch(START + place, (message,)))
    assert digest.digest() == hashlib.sha256(records(messages)).digest()


def test_an_end_of_before_a_consumer_was_started_anew_is_passed_over() -> None:
    """It has no digest from where that consumer begins now; the next one has, and is compared."""
    offer = Offer(RUN.hex(), {}, [], sender=SENDER.hex())
    machine, sealing, digests = receiver(), Sealing(offer), StreamDigests()
    offered = sealing.hello(machine)
    assert isinstance(offered, Offered)
    machine.accept(offered, START, 0.0)
    new = []
    for start in (0, START):
        digests.begin("learner", start)
        end = Frame(FrameType.END, RUN, SENDER, START, digests=digests.packed())
        digests.begin("another", start)
        new.append(machine.on_sample(*sealing.frame(end), 0.0))
    assert new == [None, end]
