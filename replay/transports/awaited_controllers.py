"""Served controllers that a stream awaits: they acknowledge nothing, but are there and receive its first message."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Self

from recorders.errors import WireError
from recorders.messages.topics import type_of
from recorders.nodes.keys import controller_key
from recorders.wire.keys.topic_keys import MessagePublisher
from recorders.wire.session import Session, has_subscribers, watching_tokens

_MAX_STATUS = 1 << 20  # anybody may answer [bytes]
_MAX_TOPICS = 100
_ANSWER_S = 5.0
_RETRY_S = 0.01


@dataclass(frozen=True)
class ControllerAnswer:
    """Answer of a served controller.

    Attributes
    ----------
    status : dict
        Its status, as JSON has it.
    session : str
        Identifier of the session that answered: another one is of a controller that was started again.
    """

    status: dict[str, Any]
    session: str


class AwaitedControllers:
    """The controllers that a stream awaits, from the first message on: one that goes before the end fails it.

    Parameters
    ----------
    session : Session
        An open session.
    namespace : str
        First part of every key.
    """

    def __init__(self, session: Session, namespace: str) -> None:
        self._session = session
        self._namespace = namespace
        self._sessions: dict[str, str] = {}
        self._gone: list[str] = []
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def add(self, name: str, answer: ControllerAnswer) -> None:
        """Await the one that has answered under a name."""

        def on_token(_key: str, is_there: bool) -> None:
            if not is_there:
                self._gone.append(name)

        key = controller_key(self._namespace, name, "alive")
        self._stack.enter_context(watching_tokens(self._session, key, on_token))
        self._sessions[name] = answer.session

    def check(self) -> None:
        """Check that they are there, and were all the time.

        Raises
        ------
        WireError
            If one was stopped, or the connection to it cut, even if it is back: what was sent meanwhile was lost.
        """
        if self._gone:
            raise _lost(self._gone[0])

    def results(self) -> dict[str, dict[str, Any]]:
        """Return the status of each by name; as it is queried behind the stream, each has received all of it.

        Raises
        ------
        WireError
            If one does not answer, was lost before, or another answers in its place.
        """
        answers = {name: ask_controller(self._session, name, namespace=self._namespace) for name in self._sessions}
        self.check()
        for name, answer in answers.items():
            if answer is None or answer.session != self._sessions[name]:
                raise _lost(name)
        return {name: answer.status for name, answer in answers.items() if answer is not None}


def _lost(name: str) -> WireError:
    return WireError(
        f"controller {name!r} was lost before the end of the replay: it was stopped, or the connection cut; "
        "what it did not answer is lost: start it again, then the replay"
    )


def ask_controller(session: Session, name: str, *, namespace: str) -> ControllerAnswer | None:
    """Ask a served controller for its status; None if none of this name answers.

    Raises
    ------
    WireError
        If whoever answers is no controller.
    """
    for reply in session.get(controller_key(namespace, name, "status"), timeout=_ANSWER_S):
        if reply.ok is not None and len(reply.ok.payload) <= _MAX_STATUS:
            return ControllerAnswer(_parsed(name, reply.ok.payload.to_bytes()), str(reply.replier_id))
    return None


def await_matching(
    publisher_of: Callable[[str, str], MessagePublisher],
    status: dict[str, Any],
    *,
    types: Mapping[str, str] | None,
    wait_s: float,
) -> None:
    """Wait until what is put on a controller's topics reaches somebody: before, it would be lost without a word.

    Parameters
    ----------
    publisher_of : callable
        Returns the publisher of a topic and type.
    status : dict
        As `ask_controller` returns it: the controller has subscribed already.
    types : mapping of str to str, optional
        Types of the topics that are sent, of which alone it waits; those of our topics if left out.
    wait_s : float
        How long that may take [s].

    Raises
    ------
    WireError
        If it takes longer.
    """
    deadline_s = time.monotonic() + wait_s
    known = {topic: kind for topic in status["topics"] if (kind := type_of(topic))} if types is None else types
    for topic in status["topics"]:
        if topic not in known:
            continue
        publisher = publisher_of(topic, known[topic])
        while not has_subscribers(publisher):
            if time.monotonic() > deadline_s:
                raise WireError(
                    f"controller {status['name']!r} answers, but nothing that is put on {topic} reaches it within "
                    f"{wait_s:g} s; may this session write there?"
                )
            time.sleep(_RETRY_S)


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
