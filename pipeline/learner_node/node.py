"""The nodes of learning: the online learner and the replay that feeds it, each in a process of its own over Zenoh."""

import logging
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import PairingRule
from pipeline.training.trainer import Trainer
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import batch_topic
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.transports.clock import Clock, Unpaced, paced
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import Source
from replay.transports.zenoh import ZenohTransport

logger = logging.getLogger(__name__)

_UNPACED = Unpaced()
_NAME_DIGITS = 8  # of a session's identifier, by which a replay differs from others


def own_topics(pairing: PairingRule, robot: RobotConfig | None) -> frozenset[str]:
    """Return the topics of a learner: a message here of no stream of its own is refused.

    Until it is known whose hands they are, they are taken to be left and right.
    """
    hands = ("left", "right") if robot is None else robot.hand_names
    return frozenset({SESSION_PHASE, batch_topic(), *pairing.topics(hands)})


def learn(
    trainer: Trainer,
    *,
    session: SessionConfig,
    receiver: ReceiverConfig,
    metrics_port: int | None = None,
) -> dict[str, Any]:
    """Wait for a stream over Zenoh, learn from all of it, and return the result.

    That it waits is logged, and what it refuses and loses sight of. A checkpoint, if there is to be one, is also kept
    when the learner is stopped. With a `metrics_port`, its status is there for Prometheus, on 127.0.0.1.

    Raises
    ------
    WireError
        If no session can be opened, or the sender fails or falls silent.
    ReenactError
        If a message is not what it should be.
    """
    with (
        open_session(session) as opened,
        receiver.keys.joined(opened),
        LearnerPublisher(opened, keys=receiver.keys) as publisher,
        Receiver(opened, config=receiver) as receiving,
        running_node(
            opened,
            _learner(trainer, receiving, publisher, name=receiver.name),
            config=session,
            namespace=receiver.namespace,
            metrics_port=metrics_port,
        ),
    ):
        trainer.report_to(publisher.report)
        trainer.show_steps_to(publisher.show)
        logger.info(
            f"{receiver.name} waits for a replay or a live session that awaits it by this name, "
            f"at {', '.join(session.listen or session.connect)}"
        )
        try:
            return receiving.serve(trainer)
        except BaseException:
            trainer.save_checkpoint()
            raise


def _learner(trainer: Trainer, receiver: Receiver, publisher: LearnerPublisher, *, name: str) -> NodeSource:
    """Return the status of a learner that waits for a stream."""

    def state() -> str:
        """Return the state of the learner."""
        return "waiting" if receiver.offer is None else "learning"

    def counts() -> dict[str, int]:
        """Return the counts of the learner."""
        return {
            "ticks": trainer.ticks,
            "messages": receiver.progress.next,
            "refused": sum(tuple(receiver.refused.values())),
        }

    return NodeSource("learner", name, state=state, counts=counts, digests=lambda: publisher.digests)


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
