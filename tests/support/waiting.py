"""Waits for something to be so, never for an amount of time: a test that waits longer than this has failed."""

import time
from collections.abc import Callable

import zenoh

from recorders.wire.frames import control_key

_DEADLINE_S = 60.0
_POLL_S = 0.01


def wait_until(holds: Callable[[], object], *, timeout_s: float = _DEADLINE_S) -> None:
    """Wait until something holds; fails where it does not come about."""
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline_s, "it does not come about"
        time.sleep(_POLL_S)


def wait_for_arrival(session: zenoh.Session, consumer: str, *, namespace: str = "reenact") -> None:
    """Wait until a consumer answers: what this session put before has come there before the question."""
    replies = session.get(control_key(namespace, consumer, "status"), timeout=_DEADLINE_S)
    assert [reply for reply in replies if reply.ok is not None]
