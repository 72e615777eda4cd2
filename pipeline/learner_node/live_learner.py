"""A learner that learns live: what anyone publishes goes in, outputs, errors and digests come out."""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.live import AlignedStream, LiveInputs
from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors
from pipeline.learner_node.live_choice import LiveChoice
from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.samples.pairing import PairingRule, find_pairing
from pipeline.training.run import CycleReport, Steps
from pipeline.training.trainer import Trainer
from recorders.errors import ConfigError, WireError
from recorders.messages.record import RecordedMessage
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.stream import Offer
from recorders.wire.queries import ReceivedOffer
from recorders.wire.receiver import Event, Receiver
from recorders.wire.subscription import LiveMessage
from replay.sources.live import live_offer
from replay.sources.schedule import Schedule

logger = logging.getLogger(__name__)

_QUIET_S = 0.02  # after this, what has come so far is learned at once, rather than with what comes next
_POLL_S = 0.5
_REPORT_TICKS = 64  # between two words on the network
_CM_PER_M = 100.0
_STOPPED = "the learner was stopped"


@dataclass(frozen=True)
class LiveConfig:
    """End of live learning, and the log that it writes.

    Parameters
    ----------
    epochs : int
        Epochs of the run, over which the rates fall; without phase markers it stays in the first.
    ticks : int, optional
        End after so many ticks.
    record : Path, optional
        Log to write: what was learned from, with the phase markers that were followed.
    overwrite : bool
        Whether a log of this name may be replaced.
    alignment : AlignmentConfig, optional
        How topics with rates and stamps of their own are aligned; if left out, ticks are taken as they are published.
    renames : mapping of str to str
        Our topic names for those that are published.

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    epochs: int = 1
    ticks: int | None = None
    record: Path | None = None
    overwrite: bool = False
    alignment: AlignmentConfig | None = None
    renames: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.epochs < 1 or (self.ticks is not None and self.ticks < 1):
            raise ConfigError(f"expected epochs and ticks of at least 1, found {self.epochs} and {self.ticks}")


def wanted_types(pairing: PairingRule, robot: RobotConfig, config: LiveConfig) -> dict[str, str]:
    """Return the types of all topics that a live learner may take, by the names that they are published under."""
    found: dict[str, str] = {}
    for tick in dict.fromkeys(each.topics(robot.hand_names) for each in (pairing, _otherwise(pairing))):
        found |= LiveInputs(robot, config.alignment, renames=config.renames, tick=tick).types
    return {topic: kind for topic, kind in found.items() if kind}


def _otherwise(pairing: PairingRule) -> PairingRule:
    """Return the pairs in the place of some if their ticks do not come."""
    return find_pairing(pairing.otherwise) if pairing.otherwise else pairing


class LiveLearner:
    """Trainer between a subscription and a publisher.

    Parameters
    ----------
    trainer : Trainer
        The learner.
    robot : RobotConfig
        The robot.
    config : LiveConfig
        When it ends.
    receiver : Receiver
        One that receives live messages too.
    publisher : LearnerPublisher
        Publishes the results.
    """

    def __init__(
        self,
        trainer: Trainer,
        robot: RobotConfig,
        config: LiveConfig,
        receiver: Receiver,
        publisher: LearnerPublisher,
    ) -> None:
        self._trainer, self._robot, self._config = trainer, robot, config
        self._receiver, self._publisher = receiver, publisher
        self._choice = self._make_choice()
        self._scores = _Scores(robot)
        self._ended = False  # a stream that awaited this is through
        self._reported = 0

    def run(
        self,
        stopped: Callable[[], bool],
        *,
        keep: Callable[[RecordedMessage], None],
        on_choice: Callable[[tuple[str, ...]], None] = lambda tick: None,
    ) -> dict[str, Any]:
        """Learn until it is `stopped`, has enough, or a stream that awaits this ends; return the result.

        `keep` is given every message that is learned from, and every marker that is followed, `on_choice` the topics
        of the ticks before that.

        Raises
        ------
        ReenactError
            As `Trainer.hello`, `Trainer.consume` and `keep` do.
        """
        self._trainer.report_to(lambda report: self._publisher.report(report, **self._counts()))
        self._trainer.show_steps_to(self._show)
        received = self._with_each_stored(self._received(stopped), keep, on_choice)
        first = list(islice(received, 1))  # a marker, which names the run
        texts = {"toml": self._robot.toml_text, "urdf": self._robot.urdf_text}
        try:
            with self._receiver.reporting_failure():
                run, tick = self._stream.run, self._choice.tick
                offer = live_offer(run, epochs=self._config.epochs, robot=texts, tick=tick)
                self._trainer.hello(replace(offer, logs=self._stream.inputs.account))
                self._trainer.take(chain(first, received))
                self._trainer.check_learned(self._stream.losses)
        finally:
            self._trainer.save_checkpoint()
        result = self._trainer.result() | {"run": self._stream.run} | self._counts()
        self._take_leave(result)
        return result

    def source(self, name: str) -> NodeSource:
        """Return the status of this learner."""
        return NodeSource(
            "learner",
            name,
            state=lambda: "learning live" if self._choice.ticks else "waiting",
            counts=lambda: {
                "ticks": self._choice.ticks,
                "dropped": self._stream.dropped,
                "gaps": self._stream.gaps,
                "refused": sum(tuple(self._stream.refused.values())) + sum(tuple(self._receiver.refused.values())),
            },
            digests=lambda: self._publisher.digests,
        )

    @property
    def _stream(self) -> AlignedStream:
        """The stream of the ticks that are learned."""
        return self._choice.stream

    def _make_choice(self) -> LiveChoice[AlignedStream]:
        """Return the choice between the ticks of the pairs that are asked for and of those in their place."""
        asked, hands = self._trainer.pairing, self._robot.hand_names
        phase, check = self._trainer.checkpoint_phase, range_check(self._robot)

        config = self._config

        def make(tick: tuple[str, ...]) -> AlignedStream:
            """Return a stream of ticks on some topics."""
            inputs = LiveInputs(self._robot, config.alignment, renames=config.renames, tick=tick)
            return AlignedStream(inputs, epochs=config.epochs, check=check, tick=tick, poses=check.poses, phase=phase)

        return LiveChoice(make, asked.topics(hands), _otherwise(asked).topics(hands))

    def _with_each_stored(
        self,
        records: Iterator[RecordedMessage],
        keep: Callable[[RecordedMessage], None],
        on_choice: Callable[[tuple[str, ...]], None],
    ) -> Iterator[RecordedMessage]:
        """Yield the stream, with every message kept; once it begins it is chosen."""
        for index, record in enumerate(records):
            if index == 0:
                on_choice(self._choice.tick)
            keep(record)
            yield record

    def _received(self, stopped: Callable[[], bool]) -> Iterator[RecordedMessage]:
        """Yield the stream that a learner can take, until it is over; in a pause, what came before it is learned."""
        quiet = False
        while not (self._ended or self._has_enough() or stopped()):
            event = self._event(_POLL_S if quiet else _QUIET_S)
            if event is None:
                self._pause(keep=quiet)
                quiet = True
                continue
            quiet = False
            yield from self._taken(event)
            if self._stream.ticks - self._reported >= _REPORT_TICKS:
                self._report()
        yield from self._last()
        yield from self._choice.settle()
        self._stream.finish()

    def _last(self) -> Iterator[RecordedMessage]:
        """Yield what had arrived when the learner was stopped, which is no more than a receiver lets wait."""
        self._receiver.unsubscribe()
        while not (self._ended or self._has_enough()) and (event := self._event(0.0)) is not None:
            if isinstance(event, ReceivedOffer):
                self._receiver.refuse(event, _STOPPED)
            else:
                yield from self._taken(event)

    def _taken(self, event: Event) -> Iterator[RecordedMessage]:
        """Yield what a learner can take of what came."""
        yield from self._messages(event)
        if isinstance(event, Frame) and event.messages:
            self._receiver.consumed(event)

    def _has_enough(self) -> bool:
        return self._config.ticks is not None and self._choice.ticks >= self._config.ticks

    def _event(self, wait_s: float) -> Event | None:
        try:
            return self._receiver.next_event(wait_s)
        except WireError as error:
            self._leave(str(error))
            return None

    def _messages(self, event: Event) -> Iterator[RecordedMessage]:
        """Yield what goes on of what came."""
        if isinstance(event, LiveMessage):
            yield from self._live(event)
        elif isinstance(event, ReceivedOffer):
            topics = _topics_of(event.offer)
            yield from self._choice.settle(None if topics is None else [*map(self._receiver.own_name, topics)])
            self._receiver.accept(event, 0)
        elif event.kind is FrameType.ABORT:
            self._leave(event.reason)
        else:
            self._ended = event.kind is FrameType.END
            for record in self._receiver.own_records(event):
                if not self._has_enough():
                    yield from self._choice.feed(record)

    def _live(self, event: LiveMessage) -> tuple[RecordedMessage, ...]:
        if self._receiver.offer is None:
            return self._choice.feed(event.record, numbered=event.numbered)
        if event.record.topic in self._stream.topics:
            line = f"{event.record.topic}: a message that is not of the stream that awaits this learner"
            self._stream.refuse(event.record.topic, "not of the stream", line)
        return ()

    def _leave(self, reason: str) -> None:
        """Leave a stream whose sender is gone; what it sent is learned, and anyone may go on."""
        self._receiver.abandon_stream()
        logger.warning(f"a stream broke off, the learner goes on: {reason}")

    def _take_leave(self, result: dict[str, Any]) -> None:
        if self._receiver.offer is None:
            return
        if self._ended:
            self._receiver.finish(result)
        else:
            self._receiver.fail("the learner has ended, before the stream did")

    def _pause(self, *, keep: bool) -> None:
        self._trainer.settle(keep=keep)
        if self._stream.ticks > self._reported:
            self._report()

    def _report(self) -> None:
        self._reported = self._stream.ticks
        report = self._trainer.so_far()
        if report is not None:
            self._publisher.report(self._scores.put_into(report), **self._counts())

    def _show(self, steps: Steps) -> None:
        self._publisher.show(steps)
        self._scores.add(steps)

    def _counts(self) -> dict[str, Any]:
        refused = self._stream.refused.copy()
        for reason, count in tuple(self._receiver.refused.items()):
            topic = next((topic for topic in self._stream.topics if reason.startswith(f"{topic}: ")), "elsewhere")
            refused[f"{topic}: unread"] += count
        counts = {"dropped": self._stream.dropped, "gaps": self._stream.gaps}
        return {"refused": dict(refused), **counts, **self._stream.inputs.counts}


def _topics_of(offer: Offer) -> tuple[str, ...] | None:
    """Return the topics of a tick of a stream on offer; None if it does not name them."""
    try:
        return Schedule.from_dict(offer.schedule).topics
    except ConfigError:
        return None


class _Scores:
    """Errors of the latest predictions, each from before its update."""

    def __init__(self, robot: RobotConfig) -> None:
        self._kinematics = Kinematics(robot)
        self._recent: deque[tuple[Floats, Floats]] = deque(maxlen=_REPORT_TICKS)  # u (3 hands,) and joints (n,)

    def add(self, steps: Steps) -> None:
        """Add the errors of steps."""
        self._recent.extend(zip(steps.u.copy(), steps.outputs[:, steps.u.shape[1] :], strict=True))

    def put_into(self, report: CycleReport) -> CycleReport:
        """Return the report with the mean errors of recent steps."""
        if not self._recent:
            return report
        targets, postures = (np.array(column) for column in zip(*self._recent, strict=True))
        hands_cm = (hand_errors(self._kinematics, postures, targets).mean(axis=0) * _CM_PER_M).tolist()
        return replace(report, hands_cm=tuple(hands_cm))
