"""Waits for something to be so, never for an amount of time: a test that waits longer than this has failed."""

import time
from collections.abc import Callable

import zenoh

from recorders.wire.keys.namespace import control_key
from recorders.wire.session import has_subscribers

_DEADLINE_S = 120.0
_POLL_S = 0.01


def wait_until(holds: Callable[[], object], *, timeout_s: float = _DEADLINE_S) -> None:
    """Wait until something holds; fails where it does not come about."""
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline_s, "it does not come about"
        time.sleep(_POLL_S)


def wait_for_subscriber(session: zenoh.Session, *, namespace: str = "reenact") -> None:
    """Wait until somebody who subscribes to a whole namespace is known: what is put before reaches nobody."""
    with session.declare_publisher(f"{namespace}/anything") as publisher:
        wait_until(lambda: has_subscribers(publisher))


def wait_for_arrival(session: zenoh.Session, consumer: str, *, namespace: str = "reenact") -> None:
    """Wait until a consumer answers: what this session put or passed on before has come there before the question."""
    replies = session.get(control_key(namespace, consumer, "status"), timeout=_DEADLINE_S)
    assert [reply for reply in replies if reply.ok is not None]
