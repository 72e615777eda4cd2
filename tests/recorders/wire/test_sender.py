"""The sending end: what it leaves behind when a stream is over."""

import threading

import pytest
from visitor import COUNT, OFFER, await_ready, outcome, stream_from, visitor

from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
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
