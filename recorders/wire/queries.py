"""Control keys of a consumer: it is there, answers `hello` and `status`, and publishes acknowledgements."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple, Self, TypeAlias

import zenoh

from recorders.errors import WireError
from recorders.protocol.answers import Offered
from recorders.protocol.packets import Packet
from recorders.protocol.stream import Offer
from recorders.wire.keys.namespace import control_key
from recorders.wire.session import publishing

MAX_CONTROL = 16 << 20
"""Larger questions, answers and attachments are refused unread [bytes]: an offer with a robot takes some 30 KB."""

_NAMESAKE_WAIT_S = 2.0  # a consumer that was killed is forgotten within milliseconds of its connection's end
_POLL_NAMESAKE_S = 0.1
_ANSWER_S = 5.0  # who is there is known at once; this machine may be very busy

Answer: TypeAlias = Callable[[Packet], None]
"""Answers a query, once."""

TakeQuery: TypeAlias = Callable[[Packet, Answer], None]
"""Takes what was asked and what answers it, on a thread of Zenoh's, and sees to it that it is answered."""


class ReceivedOffer(NamedTuple):
    """A stream on offer, to be accepted or refused."""

    offered: Offered
    answer: Answer

    @property
    def offer(self) -> Offer:
        """The stream."""
        return self.offered.offer


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
    on_hello, on_status : callable
        Take what was asked.
    """

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str,
        name: str,
        *,
        on_hello: TakeQuery,
        on_status: TakeQuery,
    ) -> None:
        self._session = session
        self._keys = {verb: control_key(namespace, name, verb) for verb in ("ack", "status", "hello")}
        self._on_hello, self._on_status = _answering(on_hello), _answering(on_status)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            enter, blocking = stack.enter_context, zenoh.CongestionControl.BLOCK
            self._ack = enter(publishing(self._session, self._keys["ack"], congestion_control=blocking))
            enter(self._session.declare_queryable(self._keys["status"], self._on_status))
            enter(self._session.declare_queryable(self._keys["hello"], self._on_hello))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def acknowledge(self, packet: Packet) -> None:
        """Publish how far the consumer has come."""
        self._ack.put(packet.payload, attachment=packet.attachment or None)


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


def _answering(take: TakeQuery) -> Callable[[zenoh.Query], None]:
    def on_query(query: zenoh.Query) -> None:
        def answer(packet: Packet) -> None:
            with query:
                query.reply(query.key_expr, packet.payload, attachment=packet.attachment or None)

        take(read_packet(query.payload, query.attachment), answer)

    return on_query


def read_packet(payload: zenoh.ZBytes | None, attachment: zenoh.ZBytes | None) -> Packet:
    """Return what came as a packet; a part of more than `MAX_CONTROL` bytes is left unread, and so never authentic."""
    return Packet(_bytes(payload), _bytes(attachment))


def _bytes(found: zenoh.ZBytes | None) -> bytes:
    return b"" if found is None or len(found) > MAX_CONTROL else found.to_bytes()
