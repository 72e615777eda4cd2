"""The node of learning: the online learner in a process of its own, fed over Zenoh."""

import logging
from typing import Any

from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import PairingRule
from pipeline.training.trainer import Trainer
from recorders.messages.topics import SESSION_PHASE
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import batch_topic
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session

logger = logging.getLogger(__name__)


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
