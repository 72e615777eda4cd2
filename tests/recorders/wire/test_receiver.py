"""The receiving end and strangers: what waits is bounded, and what is said of them too, and fit for a terminal."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
import zenoh
from collector import Collector
from sealed import Peer
from stepped_clock import SteppedClock
from visitor import OFFER, await_ready, outcome, visitor
from waiting import wait_until

from recorders.errors import WireError
from recorders.protocol.frames import Frame, FrameType, pack
from recorders.protocol.receiver import FAREWELL_WAIT_S
from recorders.protocol.stream import Offer, Progress, asking
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


def alive(session: zenoh.Session, consumer: str) -> bool:
    """Whether a consumer is known to be there."""
    replies = session.liveliness().get(control_key("reenact", consumer, "alive"), timeout=120.0)
    return any(reply.ok is not None for reply in replies)


def accepted(
    receiver: Receiver, session: zenoh.Session, offer: Offer
) -> tuple[Peer, "zenoh.handlers.Handler[zenoh.Reply]"]:
    """Have a sender's stream accepted from its beginning; returns the sender, and the answers to its offer."""
    peer = Peer(session, offer)
    replies = peer.offer()
    offered = receiver.next_event(120.0)
    assert isinstance(offered, ReceivedOffer)
    receiver.accept(offered, 0)
    return peer, replies


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
            peer = Peer(other, offer)
            replies = peer.offer()
            offered = receiver.next_event(120.0)
            assert isinstance(offered, ReceivedOffer)
            receiver.accept(offered, 0)
            assert [reply.ok is not None for reply in replies] == [True]
            receiver.abandon_stream("nobody knows why")
            peer.put(Frame(FrameType.END, *offer.identity, 0))
            for verb, asked in (("status", offer.sender.encode()), ("hello", offer.to_json())):
                answer = peer.ask(verb, asked)
                assert answer is not None
                assert (answer.run, answer.error) == (offer.run, "nobody knows why")
            assert receiver.next_event(0.2) is None


def test_a_sender_that_is_gone_before_it_has_the_result_is_left_and_told_if_it_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, offer = SteppedClock(monkeypatch), replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other), Receiver(session, config=ReceiverConfig(live=True)) as receiver:
        peer, replies = accepted(receiver, other, offer)
        assert [reply.ok is not None for reply in replies] == [True]
        receiver.report({"count": 3})
        for _ in range(round(FAREWELL_WAIT_S)):
            assert not receiver.is_released()
            clock.step()
        assert receiver.is_released()
        assert receiver.offer is None
        answer = peer.ask("status", offer.sender.encode())
        assert answer is not None
        assert (answer.run, answer.result) == (offer.run, {"count": 3})


def test_what_strangers_make_it_say_is_bounded_and_printable(caplog: pytest.LogCaptureFixture) -> None:
    with two_sessions() as (session, other), Receiver(session) as receiver:
        for index in range(3):
            offer = Offer(run="ab" * 16, schedule={}, logs=[], sender=f"{index:032x}")
            Peer(other, offer).offer()
            offered = receiver.next_event(120.0)
            assert isinstance(offered, ReceivedOffer)
            receiver.refuse(offered, "not now \x1b[2J")
    assert caplog.messages == [r"refused an offer: not now \x1b[2J"]


def test_the_reason_of_a_sender_that_gives_up_is_printable() -> None:
    offer = replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other), Receiver(session) as receiver:
        peer, replies = accepted(receiver, other, offer)
        assert [json.loads(reply.ok.payload.to_bytes())["next"] for reply in replies if reply.ok] == [0]
        peer.put(Frame(FrameType.ABORT, *offer.identity, 0, reason="\x1b]0;mine\x07" + "a" * 5_000))
        frame = receiver.next_event(120.0)
    assert isinstance(frame, Frame)
    assert frame.reason.isprintable()
    assert len(frame.reason) < 1_100


def test_what_is_not_sealed_is_refused_and_counted_and_changes_nothing() -> None:
    offer = replace(OFFER, sender="cd" * 16)
    with two_sessions() as (session, other), Receiver(session) as receiver:
        peer, replies = accepted(receiver, other, offer)
        assert [reply.ok is not None for reply in replies] == [True]
        for kind in (FrameType.BATCH, FrameType.END, FrameType.ABORT):
            payload, attachment = pack(Frame(kind, *offer.identity, 0, reason="forged"))
            other.put(batch_key("reenact"), payload, attachment=attachment + bytes(24))
        forged = other.get(control_key("reenact", "learner", "status"), payload=asking(offer, farewell=True))
        assert [reply.ok.attachment for reply in forged if reply.ok is not None] == [None]
        for reply in other.get(control_key("reenact", "learner", "hello"), payload=offer.to_json()):
            assert reply.ok is not None
            assert "not sealed with the key" in reply.ok.payload.to_string()
        answer = peer.ask("status", asking(offer))
        assert answer == Progress(offer.run, 0, 0)
        assert receiver.offer == offer
        assert sorted(receiver.refused.values()) == [1, 1, 3]
        assert receiver.next_event(0.0) is None


def test_a_sender_of_another_version_is_refused_in_words_that_it_understands() -> None:
    with two_sessions() as (session, other), Receiver(session):
        fields = json.loads(OFFER.to_json()) | {"version": 1}
        (reply,) = other.get(control_key("reenact", "learner", "hello"), payload=json.dumps(fields), timeout=120.0)
        assert reply.ok is not None
        answer = json.loads(reply.ok.payload.to_bytes())
    assert set(answer) == {"run", "next", "received", "result", "error"}
    assert answer["error"] == "offer: expected protocol version 2, found 1"
