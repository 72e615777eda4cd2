"""A callback without a thread of its own, on threads that keep what Python needs on them."""

import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
import zenoh
from waiting import wait_until

from recorders.wire.callbacks import on_network_thread
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, has_subscribers, open_session

COUNT = 50


def test_a_thread_of_zenohs_keeps_its_state_between_two_calls() -> None:
    of_thread = threading.local()  # goes with the state
    heard: queue.SimpleQueue[tuple[int, int, bytes]] = queue.SimpleQueue()

    def count(sample) -> None:
        of_thread.calls = getattr(of_thread, "calls", 0) + 1
        heard.put((threading.get_ident(), of_thread.calls, sample.payload.to_bytes()))

    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as sending,
        on_network_thread(partial(listening.declare_subscriber, "a/b"), count),
        sending.declare_publisher("a/b") as publisher,
    ):
        wait_until(lambda: has_subscribers(publisher))
        for number in range(COUNT):
            publisher.put(bytes([number]))
        calls = [heard.get(timeout=120) for _ in range(COUNT)]
    assert [payload for _, _, payload in calls] == [bytes([number]) for number in range(COUNT)]
    assert threading.main_thread().ident not in {thread for thread, _, _ in calls}
    seen: dict[int, int] = {}
    for thread, number, _ in calls:
        seen[thread] = seen.get(thread, 0) + 1
        assert number == seen[thread]


@contextmanager
def connected() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as sending,
    ):
        yield listening, sending


def put(sending: zenoh.Session) -> None:
    """Put a sample where somebody subscribes."""
    with sending.declare_publisher("a/b") as publisher:
        wait_until(lambda: has_subscribers(publisher))
        publisher.put(b"1")


def test_when_the_block_is_left_no_call_is_under_way_and_none_can_come() -> None:
    called, undeclared = threading.Event(), threading.Event()
    order: list[str] = []

    @contextmanager
    def noted(session: zenoh.Session, call: Any) -> Iterator[None]:
        with session.declare_subscriber("a/b", call):
            yield
        undeclared.set()

    def handle(sample: zenoh.Sample) -> None:
        called.set()
        assert undeclared.wait(120.0)
        order.append("handled")

    with connected() as (listening, sending):
        with on_network_thread(partial(noted, listening), handle):
            put(sending)
            assert called.wait(120.0)
        order.append("left")
    assert order == ["handled", "left"]


def test_a_handler_may_leave_the_block_itself(caplog: pytest.LogCaptureFixture) -> None:
    left = threading.Event()

    def leave(sample: zenoh.Sample) -> None:
        declared.__exit__(None, None, None)
        left.set()

    with connected() as (listening, sending):
        declared = on_network_thread(partial(listening.declare_subscriber, "a/b"), leave)
        declared.__enter__()
        put(sending)
        assert left.wait(120.0)
    assert caplog.messages == []


def test_what_cannot_be_declared_is_not_waited_for(caplog: pytest.LogCaptureFixture) -> None:
    with connected() as (listening, _):
        declare = partial(listening.declare_subscriber, "a//b")
        with pytest.raises(zenoh.ZError), on_network_thread(declare, lambda sample: None):
            pass
    assert caplog.messages == []
