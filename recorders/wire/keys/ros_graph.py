"""The graph of a ROS domain: who is in it, by liveliness tokens."""

import logging
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import zenoh

from recorders.errors import WireError
from recorders.rmw_zenoh.liveliness import EntityType, Token, tokens_of
from recorders.rmw_zenoh.names import MAX_DOMAIN
from recorders.text.once import OnceWarner
from recorders.wire.bounded_queue import LONGEST_WAIT_S
from recorders.wire.session import watching_tokens

logger = logging.getLogger(__name__)

MAX_TOKENS = 10_000
"""As many tokens are remembered: anyone may declare them."""

_MAX_DEPARTED = 1000  # tokens: anyone may declare them and go

_warnings = OnceWarner(logger, limit=MAX_DOMAIN + 1)


@dataclass(frozen=True)
class GraphView:
    """The graph of a ROS domain at one moment.

    Parameters
    ----------
    tokens : tuple of Token
        Who is there, in the order of their keys.
    """

    tokens: tuple[Token, ...]

    @property
    def nodes(self) -> list[str]:
        """Full names of the nodes, sorted; two of one name are there twice."""
        return sorted(token.node.full_name for token in self.tokens if token.entity is EntityType.NODE)

    @property
    def topics(self) -> dict[str, list[str]]:
        """Types by topic, both sorted, of everything that is published or subscribed to."""
        types: dict[str, set[str]] = {}
        for token in self.tokens:
            if token.endpoint is not None and token.entity in (EntityType.PUBLISHER, EntityType.SUBSCRIPTION):
                types.setdefault(token.endpoint.topic, set()).add(token.endpoint.type)
        return {topic: sorted(types[topic]) for topic in sorted(types)}

    def hashes(self, topic: str, type_name: str) -> list[str]:
        """Return what stands for the hash of a type where it is published or subscribed to on a topic, sorted.

        More than one: not all of these publishers and subscriptions match.
        """
        sides = (EntityType.PUBLISHER, EntityType.SUBSCRIPTION)
        ends = (token.endpoint for entity in sides for token in self.endpoints(topic, entity))
        return sorted({end.type_hash for end in ends if end is not None and end.type == type_name})

    def endpoints(self, topic: str, entity: EntityType) -> list[Token]:
        """Return the publishers or the subscriptions of a topic."""
        return self._by_side.get((topic, entity), [])

    @cached_property
    def _by_side(self) -> dict[tuple[str, EntityType], list[Token]]:
        """Tokens of publishers and subscriptions by topic, put in order once: there may be many."""
        found: dict[tuple[str, EntityType], list[Token]] = {}
        for token in self.tokens:
            if token.endpoint is not None:
                found.setdefault((token.endpoint.topic, token.entity), []).append(token)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the graph as JSON values: names of nodes, and of each topic its types and who has it."""
        return {"nodes": self.nodes, "topics": [self._topic(*entry) for entry in self.topics.items()]}

    def _topic(self, topic: str, types: list[str]) -> dict[str, Any]:
        sides = {"publishers": EntityType.PUBLISHER, "subscriptions": EntityType.SUBSCRIPTION}
        hashes = {kind: self.hashes(topic, kind) for kind in types}
        return {"topic": topic, "types": types, "hashes": hashes} | {
            side: [token.node.full_name for token in self.endpoints(topic, entity)] for side, entity in sides.items()
        }


def find_graph(session: zenoh.Session, domain: int, *, timeout_s: float = 5.0) -> GraphView:
    """Return the graph of a ROS domain as everybody whom a session reaches states it; what is no token is passed over.

    It is reported if there are more tokens than are remembered.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    domain : int
        The ROS domain.
    timeout_s : float
        How long to wait for those who do not answer [s].
    """
    found: dict[str, Token] = {}
    for reply in session.liveliness().get(tokens_of(domain), timeout=timeout_s):
        if reply.ok is not None and len(found) >= MAX_TOKENS:
            _warn_of_too_many(domain)
        elif reply.ok is not None:
            key = str(reply.ok.key_expr)
            with suppress(WireError):
                found[key] = Token.from_key(key)
    return GraphView(tuple(found[key] for key in sorted(found)))


def _warn_of_too_many(domain: int) -> None:
    _warnings.warn(f"ROS domain {domain}: more than {MAX_TOKENS} tokens in its graph: those beyond them are not known")


class RosGraph:
    """Nodes, publishers and subscriptions of a ROS domain, kept up to date while the block runs.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    domain : int
        The ROS domain.

    Attributes
    ----------
    refused : int
        How many tokens were none of rmw_zenoh, or too many.
    too_many : int
        How many of these were too many, which is also reported.
    departed : dict of str to Token
        The last that are gone, by their keys: what they published may come later.
    """

    def __init__(self, session: zenoh.Session, domain: int) -> None:
        self._session = session
        self._domain = domain
        self._changed = threading.Condition()
        self._tokens: dict[str, Token] = {}
        self.departed: dict[str, Token] = {}
        self._view: GraphView | None = None  # of these tokens, once it is asked for
        self._stack = ExitStack()
        self.refused = self.too_many = 0

    def __enter__(self) -> Self:
        watching = watching_tokens(self._session, tokens_of(self._domain), self._on_change, history=True)
        self._stack.enter_context(watching)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @property
    def view(self) -> GraphView:
        """The graph as it is now."""
        with self._changed:
            if self._view is None:
                self._view = GraphView(tuple(self._tokens[key] for key in sorted(self._tokens)))
            return self._view

    def subscriptions(self, topic: str, type_name: str = "") -> int:
        """Return how many subscriptions a topic has now, of one type if it is given."""
        ends = (token.endpoint for token in self.view.endpoints(topic, EntityType.SUBSCRIPTION))
        return sum(end is not None and type_name in ("", end.type) for end in ends)

    def wait_for(self, topic: str, number: int, *, timeout_s: float, type_name: str = "") -> None:
        """Wait until a topic has so many subscriptions, of one type if it is given.

        Raises
        ------
        WireError
            If it has fewer after the time [s].
        """
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while self.subscriptions(topic, type_name) < number and (left_s := deadline_s - time.monotonic()) > 0:
                self._changed.wait(min(left_s, LONGEST_WAIT_S))
        if (there := self.subscriptions(topic, type_name)) < number:
            kind = f" to {type_name}" if type_name else ""
            unknown = f"; {self.too_many} tokens beyond {MAX_TOKENS} are not known" if self.too_many else ""
            raise WireError(
                f"{topic}: expected {number} subscriptions{kind} within {timeout_s:.3g} s, found {there}{unknown}"
            )

    # From here on: Zenoh's threads.

    def _on_change(self, key: str, present: bool) -> None:
        with self._changed:
            if not present:
                self._leave(key)
            elif len(self._tokens) >= MAX_TOKENS:
                self.refused += 1
                self.too_many += 1
                _warn_of_too_many(self._domain)
            else:
                self._add(key)
            self._view = None
            self._changed.notify_all()

    def _leave(self, key: str) -> None:
        token = self._tokens.pop(key, None)
        if token is not None:
            self.departed = dict([*self.departed.items(), (key, token)][-_MAX_DEPARTED:])

    def _add(self, key: str) -> None:
        try:
            self._tokens[key] = Token.from_key(key)
        except WireError:
            self.refused += 1
