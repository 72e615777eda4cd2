"""The receiving end and strangers: what waits is bounded, and what is said of them too, and fit for a terminal."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
import zenoh
from collector import Collector
from visitor import OFFER, await_ready, outcome, visitor
from waiting import wait_until

from recorders.errors import WireError
from recorders.protocol.frames import Frame, FrameType, pack
from recorders.protocol.stream import Offer, Progress
from recorders.wire.keys.namespace import batch_key, control_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.queries import ReceivedOffer
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.subscription import LiveMessage


@contextmanager
def two_sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as connected,
    ):
        yield listening, connected


def ask(session: zenoh.Session, verb: str, payload: bytes) -> Progress | None:
    """Ask the consumer; when it answers, what was put before has come there too."""
    for reply in session.get(control_key("reenact", "learner", verb), payload=payload, timeout=120.0):
        if reply.ok is not None:
            return Progress.from_json(reply.ok.payload.to_bytes())
    return None


def alive(session: zenoh.Session, consumer: str) -> bool:
    """Whether a consumer is known to be there."""
    replies = session.liveliness().get(control_key("reenact", consumer, "alive"), timeout=120.0)
    return any(reply.ok is not None for reply in replies)


def test_live_messages_beyond_what_may_wait_are_lost_and_counted() -> None:
    config = ReceiverConfig(live=True, waiting_bytes=20_000)
    with two_sessions() as (session, other), Receiver(session, config=config) as receiver:
        with other.declare_publisher("reenact/raw", congestion_control=zenoh.CongestionControl.BLOCK) as publisher:
            for index in range(100):
                publisher.put(index.to_bytes(2, "little") * 500)
            wait_until(lambda: sum(receiver.refused.values()) >= 91)  # while it is taken from there would be room again
        taken = []
        while isinstance(event := receiver.next_event(0.5), LiveMessage):
            taken.append(event.record.data[0])
        assert taken == list(range(9))
        assert receiver.refused == {"/raw: lost, as 20000 bytes wait already": 91}


def test_a_stream_loses_nothing_although_little_may_wait() -> None:
    endpoint = free_endpoint()
    config = ReceiverConfig(waiting_bytes=8_000)
    with open_session(SessionConfig(listen=(endpoint,))) as session, Receiver(session, config=config) as receiver:
        with visitor("replay", connect=[endpoint]) as sender:
            result = receiver.serve(Collector(delay_s=0.001), wait_s=120.0)
            assert outcome(sender) == result
    assert result["count"] == 200


def test_a_second_consumer_of_a_name_is_refused_until_the_first_has_gone() -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with visitor("learn", connect=[endpoint]) as first:
            await_ready(first)
            wait_until(lambda: alive(session, "learner"))  # the token comes by another way than the word
            with pytest.raises(WireError, match="a consumer 'learner' is in namespace 'reenact' already"):
                Receiver(session).__enter__()
            with Receiver(session, config=ReceiverConfig(name="other")):
                pass
            first.kill()
        wait_until(lambda: not alive(session, "learner"))
        with Receiver(session):
            pass


def test_a_stream_that_was_left_is_over_for_good() -> None:
    offer = replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other):
        with Receiver(session, config=ReceiverConfig(live=True)) as receiver:
            replies = other.get(control_key("reenact", "learner", "hello"), payload=offer.to_json(), timeout=120.0)
            offered = receiver.next_event(120.0)
            assert isinstance(offered, ReceivedOffer)
            receiver.accept(offered, 0)
            assert [reply.ok is not None for reply in replies] == [True]
            receiver.abandon_stream("nobody knows why")
            payload, attachment = pack(Frame(FrameType.END, *offer.identity, 0))
            other.put(batch_key("reenact"), payload, attachment=attachment)
            for verb, asked in (("status", offer.sender.encode()), ("hello", offer.to_json())):
                answer = ask(other, verb, asked)
                assert answer is not None
                assert (answer.run, answer.error) == (offer.run, "nobody knows why")
            assert receiver.next_event(0.2) is None


def test_a_sender_that_is_gone_before_it_has_the_result_is_left_and_told_if_it_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offer = replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other), Receiver(session, config=ReceiverConfig(live=True)) as receiver:
        replies = other.get(control_key("reenact", "learner", "hello"), payload=offer.to_json(), timeout=120.0)
        offered = receiver.next_event(120.0)
        assert isinstance(offered, ReceivedOffer)
        receiver.accept(offered, 0)
        assert [reply.ok is not None for reply in replies] == [True]
        receiver.report({"count": 3})
        assert not receiver.is_released()
        monkeypatch.setattr("recorders.protocol.receiver.FAREWELL_WAIT_S", 0.5)
        assert receiver.is_released(1.0)
        assert receiver.offer is None
        answer = ask(other, "status", offer.sender.encode())
        assert answer is not None
        assert (answer.run, answer.result) == (offer.run, {"count": 3})


def test_what_strangers_make_it_say_is_bounded_and_printable(caplog: pytest.LogCaptureFixture) -> None:
    with two_sessions() as (session, other), Receiver(session) as receiver:
        for index in range(3):
            offer = Offer(run="ab" * 16, schedule={}, logs=[], sender=f"{index:032x}")
            other.get(control_key("reenact", "learner", "hello"), payload=offer.to_json(), timeout=120.0)
            offered = receiver.next_event(120.0)
            assert isinstance(offered, ReceivedOffer)
            receiver.refuse(offered, "not now \x1b[2J")
    assert caplog.messages == [r"refused an offer: not now \x1b[2J"]


def test_the_reason_of_a_sender_that_gives_up_is_printable() -> None:
    offer = replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other), Receiver(session) as receiver:
        replies = other.get(control_key("reenact", "learner", "hello"), payload=offer.to_json(), timeout=120.0)
        offered = receiver.next_event(120.0)
        assert isinstance(offered, ReceivedOffer)
        receiver.accept(offered, 0)
        assert [json.loads(reply.ok.payload.to_bytes())["next"] for reply in replies if reply.ok] == [0]
        payload, attachment = pack(Frame(FrameType.ABORT, *offer.identity, 0, reason="\x1b]0;mine\x07" + "a" * 5_000))
        other.put(batch_key("reenact"), payload, attachment=attachment)
        frame = receiver.next_event(120.0)
    assert isinstance(frame, Frame)
    assert frame.reason.isprintable()
    assert len(frame.reason) < 1_100
