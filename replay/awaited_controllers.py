"""Served controllers that a stream awaits: they acknowledge nothing, but are there and hear its first message."""

import json
import time
from collections.abc import Callable
from typing import Any

import zenoh

from recorders.errors import WireError
from recorders.wire.frames import message_key
from recorders.wire.node_keys import controller_key

_MAX_STATUS = 1 << 20  # anybody may answer [bytes]
_MAX_TOPICS = 100
_ANSWER_S = 5.0
_RETRY_S = 0.01


def controller_status(session: zenoh.Session, name: str, *, namespace: str) -> dict[str, Any] | None:
    """Return what a served controller says of itself; None if none of this name answers.

    Raises
    ------
    WireError
        If whoever answers is no controller.
    """
    for reply in session.get(controller_key(namespace, name, "status"), timeout=_ANSWER_S):
        if reply.ok is not None and len(reply.ok.payload) <= _MAX_STATUS:
            return _parsed(name, reply.ok.payload.to_bytes())
    return None


def await_matching(
    publisher_on: Callable[[str], zenoh.Publisher], status: dict[str, Any], *, namespace: str, wait_s: float
) -> None:
    """Wait until what is put on a controller's topics reaches somebody: before, it would be lost without a word.

    Parameters
    ----------
    publisher_on : callable
        Returns the publisher on a key.
    status : dict
        As `controller_status` returns it: the controller has subscribed already.
    namespace : str
        First part of every key.
    wait_s : float
        How long that may take [s].

    Raises
    ------
    WireError
        If it takes longer.
    """
    deadline_s = time.monotonic() + wait_s
    for topic in status["topics"]:
        publisher = publisher_on(message_key(namespace, topic))
        while not matches(publisher):
            if time.monotonic() > deadline_s:
                raise WireError(
                    f"controller {status['name']!r} answers, but nothing that is put on {topic} reaches it within "
                    f"{wait_s:g} s; may this session write there?"
                )
            time.sleep(_RETRY_S)


def matches(publisher: zenoh.Publisher) -> bool:
    """Whether anybody subscribes to what a publisher puts."""
    status: Any = publisher.matching_status  # typed as a bool, which it is not
    return bool(status.matching)


def _parsed(name: str, data: bytes) -> dict[str, Any]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    topics = found.get("topics") if isinstance(found, dict) else None
    named = isinstance(topics, list) and len(topics) <= _MAX_TOPICS and all(isinstance(topic, str) for topic in topics)
    if found is None or not named or found.get("name") != name:
        raise WireError(f"expected the status of controller {name!r}, found {data[:80]!r}")
    return dict(found)
