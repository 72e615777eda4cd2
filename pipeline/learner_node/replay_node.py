"""The node that feeds learners: a replay in a process of its own, over Zenoh. It loads nothing that learns."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.wire.session import SessionConfig, open_session
from replay.transports.clock import Clock, Unpaced, paced
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import Source
from replay.transports.zenoh import ZenohTransport

_UNPACED = Unpaced()
_NAME_DIGITS = 8  # of a session's identifier, by which a replay differs from others


def replay(
    source: Source,
    *,
    session: SessionConfig,
    sender: SenderConfig,
    clock: Clock = _UNPACED,
    metrics_port: int | None = None,
    channels: Sequence[DeclaredChannel] = (),
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> dict[str, Any]:
    """Send a stream to the consumers that are awaited, and return their results.

    It is logged if nobody listens to a stream that nobody need await. `on_progress` is not called for a stream whose
    length nobody knows. With a `metrics_port`, the status of the replay is there for Prometheus, on 127.0.0.1.
    Recorders learn the types of what is sent from `channels`.

    Raises
    ------
    LogError
        If a log cannot be read.
    WireError
        If a consumer is not there, refuses, or stops answering.
    """
    offer = source.offer()
    sent = 0

    def counted(start: int) -> Iterator[RecordedMessage]:
        """Yield the messages at the pace of the clock, and count them."""
        nonlocal sent
        for sent, message in enumerate(paced(source.stream(start), clock), start + 1):  # noqa: B007  # reported at the end
            yield message

    def advanced(consumed: int) -> None:
        """Report progress."""
        if offer.messages:
            on_progress(consumed / offer.messages)

    with open_session(session) as opened, sender.keys.joined(opened):
        transport = ZenohTransport(opened, config=sender, on_progress=advanced, channels=channels)
        node = NodeSource(
            "replay",
            str(opened.info.zid())[:_NAME_DIGITS],
            state=lambda: "sending" if sent else "waiting",
            counts=lambda: {"messages": sent, "refused": sum(tuple(transport.refused.values()))},
        )
        with running_node(opened, node, config=session, namespace=sender.namespace, metrics_port=metrics_port):
            results = transport.deliver(offer, counted)
    return {"run": offer.run, "messages": sent, "consumers": results}
