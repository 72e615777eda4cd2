"""The base of all long-running nodes: a token, a status, metrics, and a watch on their connections."""

from collections.abc import Iterator
from contextlib import contextmanager

from recorders.nodes.connection_watch import watching_connections
from recorders.nodes.keys import NodeId
from recorders.nodes.metrics import metrics_served
from recorders.nodes.status import NodeSource, declared_node
from recorders.wire.session import Session, SessionConfig


@contextmanager
def running_node(
    session: Session,
    source: NodeSource,
    *,
    config: SessionConfig,
    namespace: str,
    metrics_port: int | None = None,
) -> Iterator[None]:
    """Let a node be seen while the block runs, and log what it loses sight of itself.

    Parameters
    ----------
    session : Session
        An open session.
    source : NodeSource
        The node.
    config : SessionConfig
        Where the session connects, resolved.
    namespace : str
        First part of every key.
    metrics_port : int, optional
        Port on 127.0.0.1 for Prometheus.

    Raises
    ------
    ConfigError
        If there are to be metrics, and the port is in use or prometheus-client is not installed.
    """
    with (
        declared_node(session, source, namespace=namespace) as meter,
        metrics_served(meter, metrics_port),
        watching_connections(session, config, own=NodeId(source.kind, source.name), namespace=namespace),
    ):
        yield
