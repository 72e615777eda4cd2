"""Control keys of a consumer: it is there, answers `hello` and `status`, and publishes acknowledgements."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple, Self, TypeAlias

import zenoh

from recorders.errors import WireError
from recorders.wire.frames import control_key
from recorders.wire.session import publishing
from recorders.wire.stream import Offer, Progress

MAX_CONTROL = 16 << 20
"""Larger questions and attachments are refused unread [bytes]: an offer with a robot's description takes some 30 KB."""

_NAMESAKE_WAIT_S = 2.0  # a consumer that was killed is forgotten within milliseconds of its connection's end
_POLL_NAMESAKE_S = 0.1
_ANSWER_S = 5.0  # who is there is known at once; this machine may be very busy

Answer: TypeAlias = Callable[[Progress], None]
"""Answers a query, once."""


class ReceivedOffer(NamedTuple):
    """A stream on offer, to be accepted or refused."""

    offer: Offer
    size: int  # as it came [bytes]
    answer: Answer


class ConsumerQueries:
    """Answers a consumer's `hello` and `status`, and publishes its acknowledgements, while the block runs.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    namespace : str
        First part of every key.
    name : str
        Name of the consumer.
    on_hello : callable
        Takes an offer, on a thread of Zenoh's, and sees to it that it is answered.
    on_status : callable
        Takes what was asked, and what answers it, likewise.
    """

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str,
        name: str,
        *,
        on_hello: Callable[[ReceivedOffer], None],
        on_status: Callable[[bytes, Answer], None],
    ) -> None:
        self._session = session
        self._keys = {verb: control_key(namespace, name, verb) for verb in ("ack", "status", "hello")}
        self._take_offer = on_hello
        self._take_question = on_status
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        enter, blocking = self._stack.enter_context, zenoh.CongestionControl.BLOCK
        self._ack = enter(publishing(self._session, self._keys["ack"], congestion_control=blocking))
        enter(self._session.declare_queryable(self._keys["status"], self._on_status))
        enter(self._session.declare_queryable(self._keys["hello"], self._on_hello))
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def acknowledge(self, progress: Progress) -> None:
        """Publish how far the consumer has come."""
        self._ack.put(progress.to_json())

    def _on_hello(self, query: zenoh.Query) -> None:
        asked, answer = _payload(query), _answer_to(query)
        try:
            offer = Offer.from_json(asked)
        except WireError as error:
            answer(Progress(error=str(error)))
            return
        self._take_offer(ReceivedOffer(offer, len(asked), answer))

    def _on_status(self, query: zenoh.Query) -> None:
        self._take_question(_payload(query), _answer_to(query))


@contextmanager
def only_of_its_name(session: zenoh.Session, namespace: str, name: str) -> Iterator[None]:
    """Be known as the consumer of a name while the block runs.

    Raises
    ------
    WireError
        If a consumer of this name is there already: a sender could not distinguish the two.
    """
    key = control_key(namespace, name, "alive")
    deadline = time.monotonic() + _NAMESAKE_WAIT_S
    while any(reply.ok is not None for reply in session.liveliness().get(key, timeout=_ANSWER_S)):
        if time.monotonic() >= deadline:
            raise WireError(
                f"a consumer '{name}' is in namespace '{namespace}' already: end it, or choose another --name"
            )
        time.sleep(_POLL_NAMESAKE_S)
    with session.liveliness().declare_token(key):
        yield


def _answer_to(query: zenoh.Query) -> Answer:
    def answer(progress: Progress) -> None:
        with query:
            query.reply(query.key_expr, progress.to_json())

    return answer


def _payload(query: zenoh.Query) -> bytes:
    return b"" if query.payload is None or len(query.payload) > MAX_CONTROL else query.payload.to_bytes()
