"""The online learner as a consumer of messages: live, replayed over Zenoh or read from a file, by the same code."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.controller import Controller
from pipeline.evaluation import hand_errors
from pipeline.kinematics import Kinematics
from pipeline.learner import Learner, state_digest
from pipeline.learner_config import LearnerConfig
from pipeline.robot import RobotConfig, parse_robot
from pipeline.samples import CommandedPairs
from recorders.cdr import decode
from recorders.errors import ConfigError, MessageError
from recorders.messages import String
from recorders.phase import EVALUATE, LEARN, Phase
from recorders.records import Stamped
from recorders.stream import Offer
from recorders.ticks import Tick, TickJoiner
from recorders.topics import SESSION_PHASE
from replay.digests import StreamDigest
from replay.engine import Replay
from replay.schedule import Schedule
from replay.transport import InProcess

Floats = NDArray[np.float64]

_PIECE = 64
"""Steps per call of the kernel. The pieces do not enter the result; one call costs as much as a step."""


@dataclass(frozen=True)
class CycleReport:
    """What one cycle came to.

    Attributes
    ----------
    epoch, cycle : int
        Counted from 0.
    phase : str
        What the cycle was for.
    error_cm : float or None
        Eq. (10), for an evaluated cycle.
    digest : str
        State digest at the end of the cycle.
    """

    epoch: int
    cycle: int
    phase: str
    error_cm: float | None
    digest: str


class Trainer:
    """Feeds a learner, message by message, and scores its predictions before each update.

    Parameters
    ----------
    config : LearnerConfig
        The learner. Its number of epochs, over which the rates fall, is the schedule's.
    robot : RobotConfig, optional
        The robot; taken from the stream's offer if left out.
    on_cycle : callable
        Told of every finished cycle.

    Attributes
    ----------
    errors_cm : list of float
        Eq. (10) of every evaluated cycle so far.
    """

    def __init__(
        self,
        config: LearnerConfig,
        *,
        robot: RobotConfig | None = None,
        on_cycle: Callable[[CycleReport], None] = lambda report: None,
    ) -> None:
        self._config = config
        self._robot = robot
        self._on_cycle = on_cycle
        self._run: _Run | None = None
        self._offer: Offer | None = None
        self.errors_cm: list[float] = []

    def hello(self, offer: Offer) -> int:
        """Make a fresh learner for the run on offer; the stream is wanted from its start.

        Raises
        ------
        ConfigError, RobotError
            If the offer's schedule or robot is not usable.
        """
        schedule = Schedule.from_dict(offer.schedule)
        robot = self._robot or _offered_robot(offer)
        self._run = _Run(replace(self._config, epochs=schedule.epochs), robot, offer.run)
        self._offer = offer
        return 0

    @property
    def epochs(self) -> int:
        """Epochs of the run that was accepted."""
        return self._running().learner.config.epochs

    def consume(self, messages: Iterator[Stamped]) -> dict[str, Any]:
        """Learn from the whole stream and return both digests, counts and the last error.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be; it is named.
        """
        run = self._running()
        for message in messages:
            if message.topic == SESSION_PHASE:
                self._end_cycle(run)
                run.begin_cycle(message)
            else:
                run.feed(message)
        self._end_cycle(run)
        return self.result()

    def result(self) -> dict[str, Any]:
        """Return what is to be said of the run so far, as JSON has it."""
        run = self._running()
        return {
            "digest": run.digest(),
            "stream_digest": run.stream.hexdigest(),
            "steps": run.steps,
            "ticks": run.ticks,
            "train_cm": self.errors_cm[-1] if self.errors_cm else None,
        }

    def controller(self) -> Controller:
        """Return what was learned, with where it comes from."""
        run = self._running()
        provenance = {
            "run": self._offer.run if self._offer else "",
            "logs": self._offer.logs if self._offer else [],
            "schedule": self._offer.schedule if self._offer else {},
            "stream_digest": run.stream.hexdigest(),
            "errors_cm": self.errors_cm,
        }
        return Controller.from_learner(
            run.learner,
            joints=run.robot.joints,
            robot_toml=run.robot.toml_text,
            robot_urdf=run.robot.urdf_text,
            pending=run.pairs.pending,
            provenance=provenance,
        )

    def _end_cycle(self, run: "_Run") -> None:
        report = run.end_cycle()
        if report is not None:
            if report.error_cm is not None:
                self.errors_cm.append(report.error_cm)
            self._on_cycle(report)

    def _running(self) -> "_Run":
        if self._run is None:
            raise ConfigError("expected an offer before the first message, found none")
        return self._run


class _Run:
    """A learner in the middle of a run: the cycle under way and the steps not yet handed to the kernel."""

    def __init__(self, config: LearnerConfig, robot: RobotConfig, run: str) -> None:
        self.robot = robot
        output_centre = np.concatenate([robot.input_centre, robot.comfort])
        self.learner = Learner(config, input_centre=robot.input_centre, output_centre=output_centre)
        self.pairs = CommandedPairs(robot.joints)
        self.stream = StreamDigest()
        self.steps = self.ticks = 0
        self._name = run
        self._kinematics = Kinematics(robot)
        self._joiner = TickJoiner()
        self._phase: Phase | None = None
        self._epoch = -1
        self._u = np.empty((_PIECE, robot.input_centre.size))
        self._d = np.empty((_PIECE, output_centre.size))
        self._filled = 0
        self._scored: list[Floats] = []

    def begin_cycle(self, message: Stamped) -> None:
        """Follow a phase marker."""
        marker = decode(message.type, message.data)
        if not isinstance(marker, String):
            raise MessageError(f"{message.topic}: expected {String.TYPE}, found {message.type}")
        phase = Phase.from_message(marker)
        if phase.run != self._name:
            raise MessageError(f"{message.topic}: expected run {self._name}, found {phase.run}")
        self.stream.update([message])
        self.pairs.begin()
        self._joiner.clear()
        self._phase = phase
        if phase.epoch != self._epoch:
            self._epoch = phase.epoch
            self.learner.begin_epoch(phase.epoch)

    def feed(self, message: Stamped) -> None:
        """Take one message; steps are made as ticks come complete."""
        if self._phase is None:
            raise MessageError(f"{message.topic}: expected a phase marker first, found message {message.sequence}")
        for tick in self._joiner.feed(message):
            self._take(tick)

    def end_cycle(self) -> CycleReport | None:
        """Finish the cycle under way, if there is one."""
        if self._phase is None:
            return None
        self._joiner.finish()
        self._flush()
        error_cm = float(np.concatenate(self._scored).mean() * 100.0) if self._scored else None
        self._scored = []
        return CycleReport(self._phase.epoch, self._phase.cycle, self._phase.phase, error_cm, self.digest())

    def digest(self) -> str:
        """Return the state digest."""
        return state_digest(self.learner.state(), pending=self.pairs.pending)

    def _take(self, tick: Tick) -> None:
        self.stream.update(tick.records)
        self.ticks += 1
        if self.pairs.fill(tick, self._u[self._filled], self._d[self._filled]):
            self._filled += 1
            if self._filled == _PIECE:
                self._flush()

    def _flush(self) -> None:
        """Hand the steps that are complete to the kernel: predict, then update."""
        if self._filled == 0 or self._phase is None:
            return
        u, d = self._u[: self._filled], self._d[: self._filled]
        outputs = self.learner.step(u, d, learning=self._phase.phase == LEARN)
        if self._phase.phase == EVALUATE:
            self._scored.append(hand_errors(self._kinematics, outputs[:, u.shape[1] :], u))
        self.steps += self._filled
        self._filled = 0


def _offered_robot(offer: Offer) -> RobotConfig:
    texts = offer.robot.get("toml"), offer.robot.get("urdf")
    if not all(isinstance(text, str) for text in texts):
        raise ConfigError("the stream names no robot, and none was given; give one with --robot")
    return parse_robot(str(texts[0]), str(texts[1]))


def train(
    paths: Sequence[Path],
    *,
    schedule: Schedule,
    config: LearnerConfig,
    on_cycle: Callable[[CycleReport], None] = lambda report: None,
) -> Trainer:
    """Train a learner straight from logs: the same messages, in the same order, as a replay sends.

    Raises
    ------
    ReenactError
        If a log, its robot or a message is not what it should be.
    """
    replay = Replay(paths, schedule)
    trainer = Trainer(config, on_cycle=on_cycle)
    InProcess({"learner": trainer}).deliver(replay.offer(), replay.stream)
    return trainer
