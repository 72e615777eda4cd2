"""What is not sealed by whom it seems to be from is refused, whatever bit differs; no nonce is ever used twice."""

import random
from collections import Counter
from contextlib import suppress
from dataclasses import replace

import pytest
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from hypothesis import given
from hypothesis import strategies as st
from sealed import INSTANCE, KEY, Sealing, receiver, sender
from small_world import Consumer, World

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.incoming import MAX_REASON, IncomingStream
from recorders.protocol.packets import Ask, Packet
from recorders.protocol.receiver import ReceiverMachine
from recorders.protocol.seals import authentication
from recorders.protocol.seals.authentication import Signer, Verifier, consumer_key, sender_key
from recorders.protocol.seals.opening import Opening
from recorders.protocol.seals.sealing import ConsumerKeys, SenderSeals, instance_of
from recorders.protocol.states import ReceiverState, SenderState
from recorders.protocol.stream import Offer, Progress, asking

OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8)
SENDER = OFFER.identity[1]
ANY_BIT = st.floats(0.0, 1.0, exclude_max=True)


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


def flipped(packet: Packet, where: float) -> Packet:
    """The packet with one of its bits turned over, in the payload or in what is attached."""
    whole = bytearray(packet.payload + packet.attachment)
    bit = int(where * len(whole) * 8)
    whole[bit // 8] ^= 1 << bit % 8
    return Packet(bytes(whole[: len(packet.payload)]), bytes(whole[len(packet.payload) :]))


def receiving(sealing: Sealing) -> ReceiverMachine:
    machine = receiver()
    offered = sealing.hello(machine)
    assert isinstance(offered, Offered)
    machine.accept(offered, 0, 0.0)
    return machine


@given(where=ANY_BIT, kind=st.sampled_from(list(FrameType)))
def test_a_frame_with_any_bit_turned_over_changes_nothing(where: float, kind: FrameType) -> None:
    sealing = Sealing(OFFER)
    machine = receiving(sealing)
    messages = (message(0),) if kind in (FrameType.MESSAGE, FrameType.BATCH) else ()
    topic, packet = sealing.frame(Frame(kind, *OFFER.identity, 0, messages, reason="why"))
    with suppress(MessageError):  # or else it is of another stream by its look
        assert machine.on_sample(topic, flipped(packet, where), 20.0) is None
    assert machine.deadline_s == 30.0
    assert machine.progress == Progress(OFFER.run)
    assert machine.on_sample(topic, packet, 20.0) is not None or kind is FrameType.END
    assert machine.deadline_s == 50.0


@pytest.mark.parametrize(("topic", "type_name"), [("/other", ""), ("/count", "std_msgs/msg/Empty")])
def test_topic_and_type_of_a_message_are_sealed_too(topic: str, type_name: str) -> None:
    sealing = Sealing(OFFER)
    machine = receiving(sealing)
    _, packet = sealing.frame(Frame(FrameType.MESSAGE, *OFFER.identity, 0, (message(0),)))
    with pytest.raises(MessageError, match="not sealed by its sender"):
        machine.on_sample(topic, packet, 0.0, type_name=type_name)
    assert machine.on_sample("/count", packet, 0.0) is not None


@given(where=ANY_BIT, verb=st.sampled_from(["hello", "status"]))
def test_an_offer_or_a_question_with_any_bit_turned_over_changes_nothing(where: float, verb: str) -> None:
    refused: Counter[str] = Counter()
    machine = ReceiverMachine(
        "learner", key=KEY, instance=INSTANCE, silence_s=30.0, refuse=lambda what, why: refused.update([what])
    )
    sealing = Sealing(OFFER)
    offered = sealing.hello(machine)
    assert isinstance(offered, Offered)
    if verb == "hello":
        answer = machine.on_hello(flipped(offered.question, where))
        assert isinstance(answer, Packet)
        assert Progress.from_json(answer.payload).error
        assert machine.state is ReceiverState.IDLE
    else:
        machine.accept(offered, 0, 0.0)
        machine.finish({}, 0.0)
        question = flipped(sealing.question("status", asking(OFFER, farewell=True)), where)
        answer = machine.on_status(question)
        machine.on_status_answered(question, answer, 1.0)
        assert answer.attachment == b""
        assert machine.state is ReceiverState.REPORTED
    assert sum(refused.values()) <= 1


@given(where=ANY_BIT, kind=st.sampled_from(["answer", "ack"]))
def test_an_answer_or_an_acknowledgement_with_any_bit_turned_over_is_none(where: float, kind: str) -> None:
    seals, theirs = SenderSeals(KEY, SENDER), ConsumerKeys(KEY, "learner", INSTANCE).seals(SENDER)
    question = seals.question("learner", "status", asking(OFFER))
    answer = theirs.answer(question, Progress(OFFER.run, 1, 2).to_json())
    assert seals.is_answer("learner", question, answer)
    if kind == "answer":
        assert not seals.is_answer("learner", question, flipped(answer, where))
    else:
        acknowledgement = theirs.acknowledgement(answer.payload)
        assert seals.is_acknowledgement("learner", acknowledgement)
        assert not seals.is_acknowledgement("learner", flipped(acknowledgement, where))


def test_an_answer_is_to_its_question_and_from_one_consumer() -> None:
    seals, theirs = SenderSeals(KEY, SENDER), ConsumerKeys(KEY, "learner", INSTANCE).seals(SENDER)
    first, second = (seals.question("learner", "status", asking(OFFER)) for _ in range(2))
    answer = theirs.answer(first, b"{}")
    assert seals.is_answer("learner", first, answer)
    assert not seals.is_answer("learner", second, answer)
    assert not seals.is_answer("recorder", first, answer)
    assert not seals.is_acknowledgement("learner", answer)
    later = ConsumerKeys(KEY, "learner", b"another instance").seals(SENDER)
    assert not seals.is_acknowledgement("learner", later.acknowledgement(b"{}"))


def test_keys_differ_by_stream_direction_consumer_and_instance() -> None:
    keys = {
        sender_key(KEY, SENDER),
        sender_key(KEY, bytes(16)),
        sender_key(bytes(32), SENDER),
        *(consumer_key(KEY, SENDER, name, instance) for name in ("a", "b") for instance in (INSTANCE, bytes(16))),
        consumer_key(KEY, bytes(16), "a", INSTANCE),
    }
    assert len(keys) == 8


def test_parts_cannot_be_shifted_into_one_another() -> None:
    key = sender_key(KEY, SENDER)
    seal = Signer(key).seal(b"ab", b"c")
    assert Verifier(key).number(seal, b"ab", b"c") == 0
    for parts in ((b"a", b"bc"), (b"abc",), (b"ab", b"c", b""), (b"abc", b"")):
        assert Verifier(key).number(seal, *parts) is None
    assert Verifier(key).number(seal[:-1], b"ab", b"c") is None


def test_an_earlier_stream_that_was_overheard_is_not_taken_again_by_a_consumer_that_was_started_anew() -> None:
    sealing = Sealing(OFFER)
    overheard = sealing.hello(receiver())
    assert isinstance(overheard, Offered)
    later = receiver(instance=b"another instance")
    answer = later.on_hello(overheard.question)
    assert isinstance(answer, Packet)
    assert Progress.from_json(answer.payload) == Progress()
    assert later.state is ReceiverState.IDLE


def test_frames_and_questions_that_are_repeated_show_no_life_and_change_nothing() -> None:
    sealing = Sealing(OFFER)
    machine = receiving(sealing)
    topic, packet = sealing.frame(Frame(FrameType.MESSAGE, *OFFER.identity, 0, (message(0),)))
    new = machine.on_sample(topic, packet, 1.0)
    assert new is not None
    machine.arrived(new)
    question = sealing.question("status", asking(OFFER))
    machine.on_status_answered(question, machine.on_status(question), 2.0)
    assert machine.deadline_s == 32.0
    assert machine.on_sample(topic, packet, 25.0) is None
    machine.on_status_answered(question, machine.on_status(question), 25.0)
    assert machine.deadline_s == 32.0
    assert machine.progress.received == 1


def test_what_is_not_authentic_is_refused_and_named() -> None:
    refused: list[tuple[str, str]] = []
    machine = ReceiverMachine(
        "learner", key=KEY, instance=INSTANCE, silence_s=30.0, refuse=lambda what, why: refused.append((what, why))
    )
    why = "not sealed with the key of this consumer: start both ends with the same --key FILE"
    answer = machine.on_hello(Packet(OFFER.to_json()))
    assert answer == Packet(Progress(error=f"the offer is {why}").to_json())
    assert refused == [("hello", f"an offer that is {why}")]
    machine.on_hello(Packet(b"no offer"))
    machine.on_status(Packet(b""))  # anybody may ask
    assert len(refused) == 1
    for asked in (asking(OFFER), b"anything"):
        machine.on_status(Packet(asked))
    assert refused[1:] == [("status", f"a question that is {why}")] * 2


def test_an_acknowledgement_of_anybody_else_is_refused_and_named() -> None:
    refused: list[tuple[str, str]] = []
    opening = Opening(SenderSeals(KEY, SENDER), lambda what, why: refused.append((what, why)))
    assert opening.acknowledgement("learner", Packet(Progress().to_json())) is None
    assert refused == [("learner/ack", "an acknowledgement that is not sealed by the consumer")]


def test_an_answer_names_the_instance_that_has_sealed_it() -> None:
    for instance in (INSTANCE, b"another instance"):
        answer = ConsumerKeys(KEY, "learner", instance).seals(SENDER).answer(Packet(b""), Progress().to_json())
        assert instance_of(answer) == instance


@pytest.mark.parametrize("size", [0, 15, 17])
def test_an_instance_of_another_size_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match=f"expected an instance of 16 bytes, found {size}"):
        ConsumerKeys(KEY, "learner", bytes(size))


def test_instances_of_a_consumer_count_up_from_the_first_and_are_never_the_same() -> None:
    most = 2**128 - 1
    keys, found = ConsumerKeys(KEY, "learner", (most - 1).to_bytes(16, "big")), []
    for _ in range(4):
        found.append(int.from_bytes(keys.seals(SENDER).acknowledgement(b"").attachment[:16], "big"))
        keys.renew()
    assert found == [most - 1, most, 0, 1]


def test_a_seal_is_news_once_and_never_behind_a_later_one() -> None:
    stream = IncomingStream(OFFER, ConsumerKeys(KEY, "learner", INSTANCE).seals(SENDER), 0)
    assert [stream.is_news(number) for number in (0, 0, 3, 1, 3, 4)] == [True, False, True, False, False, True]


def test_a_consumer_with_another_key_is_named_with_what_it_says() -> None:
    refused: list[str] = []
    machine = sender(OFFER, ("learner",), batched=True, wait_s=1.0, patience_s=1.0)
    machine._opening._refuse = lambda what, why: refused.append(f"{what}: {why}")
    other, now_s = receiver(key=bytes(32)), 0.0
    machine.start(now_s)
    while not machine.is_over:
        for action in machine.outbox.take():
            assert isinstance(action, Ask)
            answer = other.on_hello(action.packet)
            assert isinstance(answer, Packet)
            machine.on_answer(action, answer, now_s)
            machine.on_answer(action, None, now_s)
        now_s = min(machine.deadline_s, 100.0)
        machine.on_time(now_s)
    assert machine.state is SenderState.FAILED
    assert "learner: it answers, but not with the key of this replay" in str(machine.error)
    assert "the offer is not sealed with the key of this consumer" in str(machine.error)
    assert set(refused) == {"learner/hello: an answer that is not sealed by the consumer"}


def test_what_anybody_answers_in_a_consumers_name_makes_no_long_line() -> None:
    opening = Opening(SenderSeals(KEY, SENDER), lambda what, why: None)
    ask = Ask(0, "learner", "hello", Packet(b""), 1.0)
    for error in ("a" * 10**6, None):
        assert not opening.is_answer(ask, Packet(Progress(error=error).to_json()))
        line = str(opening.unanswered("learner", 1.0))
        assert ("a" * MAX_REASON in line, "nothing that can be trusted" in line) == (error is not None, error is None)
        assert len(line) < MAX_REASON + 300


def test_no_nonce_is_used_twice_although_the_stream_goes_back_and_consumers_start_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Over runs in which much is lost, with several senders beside one another."""
    used: Counter[tuple[bytes, bytes]] = Counter()

    class Watched:
        def __init__(self, key: bytes) -> None:
            self._watched, self._key = AESGCM(key), key

        def encrypt(self, nonce: bytes, data: bytes, also: bytes | None) -> bytes:
            used[self._key, nonce] += 1
            return self._watched.encrypt(nonce, data, also)

        def decrypt(self, nonce: bytes, data: bytes, also: bytes | None) -> bytes:
            return self._watched.decrypt(nonce, data, also)

    monkeypatch.setattr(authentication, "AESGCM", Watched)
    for seed in range(5):
        run_with_losses(random.Random(seed), replace(OFFER, sender=f"{seed:032x}", messages=20))
    assert len(used) > 200
    assert set(used.values()) == {1}


def run_with_losses(draw: random.Random, offer: Offer) -> None:
    """Deliver a stream of which much is lost, and of which a consumer is started anew in the middle."""
    world = World({"anna": Consumer(), "bob": Consumer()}, lose=lambda action: draw.random() < 0.3, offer=offer)
    world.run(stop=lambda: world.sender.sent >= 15)
    world.consumers["bob"] = again = Consumer(2)
    again.machine = receiver("bob", instance=draw.randbytes(16))
    world.run()
