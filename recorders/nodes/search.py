"""Finds the nodes of a namespace and their statuses; replies are untrusted."""

import zenoh

from recorders.errors import WireError
from recorders.nodes.keys import KINDS, NodeId, node_key, node_of
from recorders.nodes.status import MAX_STATUS, NodeStatus

NO_ANSWER = "no answer"
"""State of a node whose token is there and that does not answer: it is stopped, or far too busy."""

MALFORMED = "malformed"
"""State of whoever answers for a node with what is no status of it."""

_TOKENS_S = 5.0  # who is there is known at once; this machine may be very busy
_MAX_NODES = 1000  # anybody may declare tokens and answer as often as they like


def find_nodes(session: zenoh.Session, *, namespace: str, timeout_s: float = 1.0) -> list[NodeStatus]:
    """Return the status of every node that a session reaches, by kind and name.

    A node with several answers is listed as often: two nodes of one name, or somebody who answers for another.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    namespace : str
        First part of every key.
    timeout_s : float
        How long a node may take to answer [s].
    """
    tokens = session.liveliness().get(node_key(namespace, "*", "*", "alive"), timeout=max(timeout_s, _TOKENS_S))
    alive = {node for reply in _bounded(tokens) if (node := _sender(namespace, reply)) is not None}
    answers = session.get(
        node_key(namespace, "*", "*", "status"),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout_s,
    )
    found = [
        _read(node, reply.ok.payload)
        for reply in _bounded(answers)
        if reply.ok is not None and (node := _sender(namespace, reply)) is not None
    ]
    answered = {(status.kind, status.name) for status in found}
    found += [NodeStatus(*node, NO_ANSWER) for node in alive if node not in answered]
    return sorted(found, key=lambda status: (KINDS.index(status.kind), status.name, status.state))


def _bounded(replies: "zenoh.handlers.Handler[zenoh.Reply]") -> list[zenoh.Reply]:
    found: list[zenoh.Reply] = []
    for reply in replies:
        found.append(reply)
        if len(found) >= _MAX_NODES:
            break
    return found


def _sender(namespace: str, reply: zenoh.Reply) -> NodeId | None:
    return None if reply.ok is None else node_of(namespace, str(reply.ok.key_expr))


def _read(node: NodeId, payload: zenoh.ZBytes) -> NodeStatus:
    try:
        if len(payload) > MAX_STATUS:
            raise WireError(f"expected at most {MAX_STATUS} bytes, found {len(payload)}")
        return NodeStatus.from_json(node, payload.to_bytes())
    except WireError as error:
        return NodeStatus(*node, f"{MALFORMED}: {error}")
