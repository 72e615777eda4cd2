"""The sending end: what it leaves behind when a stream is over."""

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
import zenoh
from collector import Collector
from visitor import COUNT, OFFER, await_ready, outcome, stream_from, visitor

from recorders.protocol.packets import Packet
from recorders.protocol.stream import Progress
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, control_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.queries import MAX_CONTROL, read_packet
from recorders.wire.receiver import Receiver
from recorders.wire.session import SessionConfig, open_session
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport


def test_the_end_of_a_process_waits_for_every_thread_of_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon is not waited for: one that returns from Zenoh while the interpreter ends aborts the process."""
    began: list[threading.Thread] = []
    start = threading.Thread.start

    def noted(thread: threading.Thread) -> None:
        began.append(thread)
        start(thread)

    endpoint = free_endpoint()
    with visitor("learn", listen=[endpoint]) as process:
        await_ready(process)
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            monkeypatch.setattr(threading.Thread, "start", noted)
            results = ZenohTransport(session).deliver(OFFER, stream_from)
        assert outcome(process) == results["learner"]
    assert results["learner"]["count"] == COUNT
    assert len(began) >= 3  # for the time, the acknowledgements, and the answers
    assert [thread.name for thread in began if thread.daemon] == []


def test_a_part_that_is_too_long_is_left_unread() -> None:
    """Of what anybody answers or acknowledges in a consumer's name, as of what anybody asks."""
    most, more = (zenoh.ZBytes(bytes(MAX_CONTROL + extra)) for extra in (0, 1))
    assert read_packet(most, None) == Packet(bytes(MAX_CONTROL), b"")
    assert read_packet(more, zenoh.ZBytes(b"seal")) == Packet(b"", b"seal")
    assert read_packet(zenoh.ZBytes(b"answer"), more) == Packet(b"answer", b"")


def test_whoever_answers_in_a_consumers_place_changes_nothing() -> None:
    """One that claims to have the complete answer, whom Zenoh by default asks alone."""
    endpoint, forged = free_endpoint(), Progress(error="forged").to_json()
    hello, status = (control_key(DEFAULT_NAMESPACE, "learner", verb) for verb in ("hello", "status"))

    def forge(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, forged, attachment=bytes(40))
            query.reply(query.key_expr, forged)

    with ExitStack() as stack:
        enter = stack.enter_context
        threads = enter(ThreadPoolExecutor())
        hosting = enter(open_session(SessionConfig(listen=(endpoint,))))
        session, impostor = (enter(open_session(SessionConfig(connect=(endpoint,)))) for _ in range(2))
        enter(impostor.declare_queryable(hello, forge, complete=True))
        enter(impostor.declare_queryable(status, forge, complete=True))
        while not any(reply.ok is not None for reply in session.get(status)):
            pass  # the network has to know of it first
        served = threads.submit(enter(Receiver(hosting)).serve, Collector(), wait_s=120.0)
        results = ZenohTransport(session, config=SenderConfig(wait_s=120.0)).deliver(OFFER, stream_from)
        assert served.result(timeout=120) == results["learner"]
    assert results["learner"]["count"] == COUNT
