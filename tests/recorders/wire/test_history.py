"""What a publisher keeps for latecomers: handed over once, whoever came first, and nothing else is touched."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
import zenoh
from waiting import wait_until
from zenoh.ext import AdvancedPublisher, CacheConfig, MissDetectionConfig, declare_advanced_publisher

from recorders.messages.topics import ROBOT_DESCRIPTION
from recorders.wire import history
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, has_subscribers, open_session
from recorders.wire.subscription import LiveMessage

KEY = message_key("reenact", ROBOT_DESCRIPTION)
KEPT = ReceiverConfig(name="recorder", live=True, latched_topics=frozenset({ROBOT_DESCRIPTION}))
_DEADLINE_S, _AFTER_S = 120.0, 0.3
BLOCK = zenoh.CongestionControl.BLOCK


@pytest.fixture
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """One session for whoever publishes, one for the receiver."""
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as connected,
    ):
        yield listening, connected


@contextmanager
def keeping(session: zenoh.Session) -> Iterator[AdvancedPublisher]:
    """A publisher that keeps its last message, as the robot's of its description does."""
    numbered = MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None)
    cache = CacheConfig(max_samples=1)
    with declare_advanced_publisher(
        session, KEY, congestion_control=BLOCK, cache=cache, publisher_detection=True, sample_miss_detection=numbered
    ) as publisher:
        yield publisher


def heard(receiver: Receiver, count: int) -> list[bytes]:
    """So many messages, however long they take, and what comes just after them, which should be none."""
    found: list[bytes] = []
    while isinstance(event := receiver.next_event(_AFTER_S if len(found) >= count else _DEADLINE_S), LiveMessage):
        found.append(event.record.data)
    return found


def test_who_comes_late_hears_the_last_one_once(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    with keeping(sessions[0]) as publisher:
        for text in (b"old", b"kept"):
            publisher.put(text)
        with Receiver(sessions[1], config=KEPT) as receiver:
            assert heard(receiver, 1) == [b"kept"]
            publisher.put(b"new")
            publisher.put(b"new")
            assert heard(receiver, 2) == [b"new", b"new"]


def test_who_was_there_first_hears_each_once(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    with Receiver(sessions[1], config=KEPT) as receiver:
        for text in (b"first", b"second"):  # two publishers, one after the other
            with keeping(sessions[0]) as publisher:
                publisher.put(text)
                assert heard(receiver, 1) == [text]


def test_messages_of_plain_publishers_all_pass(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    with Receiver(sessions[1], config=KEPT) as receiver, ExitStack() as stack:
        plain = stack.enter_context(sessions[0].declare_publisher(KEY, congestion_control=BLOCK))
        wait_until(lambda: has_subscribers(plain))  # before, what is put reaches nobody
        always_one = zenoh.SourceInfo(plain.id, 1)
        for text in (b"a", b"a", b"b"):
            plain.put(text)
            plain.put(text, source_info=always_one)
        assert heard(receiver, 6) == [b"a", b"a", b"a", b"a", b"b", b"b"]


def test_of_too_many_publishers_only_what_is_new_is_taken_and_that_is_reported(
    sessions: tuple[zenoh.Session, zenoh.Session], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(history, "_MAX_SOURCES", 0)
    with keeping(sessions[0]) as publisher:
        publisher.put(b"kept")
        with Receiver(sessions[1], config=KEPT) as receiver:
            wait_until(lambda: "latched publishers" in caplog.text)
            publisher.put(b"new")
            assert heard(receiver, 1) == [b"new"]
            assert [*receiver.refused.values()] == [1]
    assert len(caplog.messages) == 1


def test_without_being_told_so_it_asks_for_nothing(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    with keeping(sessions[0]) as publisher:
        publisher.put(b"kept")
        with Receiver(sessions[1], config=ReceiverConfig(live=True)) as receiver:
            assert heard(receiver, 0) == []
