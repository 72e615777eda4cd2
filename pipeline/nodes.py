"""The nodes of learning: the online learner and the replay that feeds it, each in a process of its own over Zenoh."""

import json
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np

from pipeline.learning_run import CycleReport
from pipeline.training import Trainer
from recorders.messages import Float64MultiArray, String
from recorders.records import Stamped
from recorders.stream import Offer
from recorders.topics import LEARNER_DIGEST, LEARNER_ERROR, LEARNER_STATUS, LEARNER_TOPICS, SESSION_PHASE
from recorders.wire.frames import batch_topic
from recorders.wire.producer import Producer
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.clock import Clock, Unpaced, paced
from replay.zenoh_transport import SenderConfig, ZenohTransport

OWN_TOPICS = frozenset({SESSION_PHASE, batch_topic(), *(topic.name for topic in LEARNER_TOPICS)})
"""What the learner listens to: a message here that is not of its stream is refused aloud."""

_M_PER_CM = 0.01
_UNPACED = Unpaced()


class Source(Protocol):
    """A stream that can be offered: a schedule over logs, a recorded session, a plain playback."""

    def offer(self) -> Offer:
        """Return what the consumers are told before the first message."""

    def stream(self, start: int = 0) -> Iterator[Stamped]:
        """Yield the messages from index `start` on."""


def learn(
    trainer: Trainer,
    *,
    session: SessionConfig,
    receiver: ReceiverConfig,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Wait for a stream over Zenoh, learn from all of it, and return what is to be said of it.

    `say` is told, a line each, when the learner is ready and what it refuses. A checkpoint, if there is to be one, is
    also kept when the learner is stopped.

    Raises
    ------
    WireError
        If no session can be opened, or the sender fails or falls silent.
    ReenactError
        If a message is not what it should be.
    """
    with (
        open_session(session) as opened,
        Producer(opened, namespace=receiver.namespace) as producer,
        Receiver(opened, config=receiver, say=say) as receiving,
    ):
        trainer.report_to(lambda report: _publish(producer, report))
        say(f"{receiver.name} waits for a replay at {', '.join(session.listen or session.connect)}")
        try:
            return receiving.serve(trainer)
        except BaseException:
            trainer.save_checkpoint()
            raise


def replay(
    source: Source,
    *,
    session: SessionConfig,
    sender: SenderConfig,
    clock: Clock = _UNPACED,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> dict[str, Any]:
    """Send a stream to the consumers that are awaited, and return their results.

    Raises
    ------
    LogError
        If a log cannot be read.
    WireError
        If a consumer is not there, refuses, or stops answering.
    """
    offer = source.offer()
    sent = 0

    def counted(start: int) -> Iterator[Stamped]:
        nonlocal sent
        for sent, message in enumerate(paced(source.stream(start), clock), start + 1):  # noqa: B007  # told at the end
            yield message

    with open_session(session) as opened:
        transport = ZenohTransport(
            opened,
            config=sender,
            on_progress=lambda consumed: on_progress(consumed / (offer.messages or consumed or 1)),
        )
        results = transport.deliver(offer, counted)
    return {"run": offer.run, "messages": sent, "consumers": results}


def _publish(producer: Producer, report: CycleReport) -> None:
    """Say on the learner's topics what a cycle came to."""
    where = {"epoch": report.epoch, "cycle": report.cycle, "phase": report.phase}
    digests = {"state": report.digest, "stream": report.stream_digest}
    producer.publish(LEARNER_DIGEST, String(json.dumps(where | digests)), log_time_ns=report.time_ns)
    producer.publish(LEARNER_STATUS, String(json.dumps(where | {"ticks": report.ticks})), log_time_ns=report.time_ns)
    if report.hands_cm is not None:
        errors = Float64MultiArray(np.array(report.hands_cm) * _M_PER_CM)
        producer.publish(LEARNER_ERROR, errors, log_time_ns=report.time_ns)
