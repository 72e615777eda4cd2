"""Reports connections that are lost, nodes that are gone, and when either is back."""

import logging
import queue
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from typing import Self

import zenoh

from recorders.nodes.keys import NodeId, node_key, node_of
from recorders.threads import background_thread
from recorders.wire.session import SessionConfig, endpoint_of, watching_tokens

logger = logging.getLogger(__name__)

LASTING = ("robot", "controller")
"""Nodes that end only on request; all others also end by themselves, and are not missed."""

_GRACE_S = 0.5
_LOST = ("lost", logging.WARNING, _GRACE_S)
_BACK = ("back", logging.INFO, 0.0)
_PACE_S = 0.1  # between two lines, whoever declares and undeclares tokens how often
_MAX_WAITING = 1000  # lines
_MAX_KNOWN = 1000  # anyone may declare a token: later ones are not looked after


class _Losses:
    """Knows what was there; what goes is lost, and what was lost may come back.

    A loss is reported a little later, with its own time: the end of a node whose peers end with it is none.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._is_there: dict[str, bool] = {}
        self._lines: queue.Queue[tuple[float, int, str]] = queue.Queue(_MAX_WAITING)  # when due, level
        self._over = threading.Event()

    @contextmanager
    def reported(self) -> Iterator[Self]:
        """Report losses while the block runs."""
        with background_thread(self._work, name="losses", stop=self._end):
            yield self

    def _end(self) -> None:
        self._over.set()
        with suppress(queue.Full):
            self._lines.put_nowait((0.0, logging.INFO, ""))

    def note(self, what: str, *, is_there: bool) -> None:
        """Note that something is there, or is not any more; report it if that is a change."""
        now = datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")
        with self._lock:
            before = self._is_there.get(what)
            if before is None and (not is_there or len(self._is_there) >= _MAX_KNOWN):
                return
            self._is_there[what] = is_there
            if before is not None and before != is_there:
                change, level, delay_s = _BACK if is_there else _LOST
                with suppress(queue.Full):
                    self._lines.put_nowait((time.monotonic() + delay_s, level, f"{change} {what} at {now}"))

    def _work(self) -> None:
        while not self._over.is_set():
            due_s, level, line = self._lines.get()
            if not self._over.wait(max(0.0, due_s - time.monotonic())):
                logger.log(level, line)
                self._over.wait(_PACE_S)


@contextmanager
def watching_connections(
    session: zenoh.Session, config: SessionConfig, *, own: NodeId | None, namespace: str
) -> Iterator[None]:
    """Report in one line, with the time, what goes and what comes back while the block runs.

    These are the connections to the endpoints that a session connects to, and all other robots and controllers of the
    namespace, wherever they are connected. Zenoh reports both as it happens; a cut that neither end notices, such as
    a pulled cable, takes as long as its lease, 10 s. To be entered after the session's own tokens are declared.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : SessionConfig
        Where it connects, resolved.
    own : NodeId or None
        The node that this session is of, if it is of one.
    namespace : str
        First part of every key.
    """

    def on_link(event: zenoh.LinkEvent) -> None:
        endpoint = endpoint_of(config.connect, str(event.link.dst))
        if endpoint is not None:
            losses.note(endpoint, is_there=event.kind == zenoh.SampleKind.PUT)

    def on_token(key: str, is_there: bool) -> None:
        node = node_of(namespace, key)
        if node is not None and node != own and node.kind in LASTING:
            losses.note(str(node), is_there=is_there)

    tokens = node_key(namespace, "*", "*", "alive")
    with (
        _Losses().reported() as losses,
        session.info.declare_link_events_listener(on_link, history=True),
        watching_tokens(session, tokens, on_token, history=True),
    ):
        yield
