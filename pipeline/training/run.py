"""A learner in the middle of a run: the cycle under way, the steps not yet handed to the kernel, what was scored."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import check_errors, hand_errors
from pipeline.learner.body import body_of
from pipeline.learner.controller import Controller
from pipeline.learner.registry import make_learner
from pipeline.learner.rule import OnlineLearner, Settings
from pipeline.learner.state import state_digest
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.samples.pairing import COMMANDED, PairingRule, find_pairing
from pipeline.samples.pairs import Presentation
from pipeline.training.joint_extent import JointExtent
from recorders.cdr.codec import decode
from recorders.errors import ControllerError, MessageError
from recorders.messages.message_types import String
from recorders.messages.phase import EVALUATE, LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import is_measured
from recorders.ticks.joiner import Tick, TickJoiner
from replay.sources.stream_digest import StreamDigest

PIECE = 64
"""Steps per call of the kernel. The pieces do not enter the result; one call costs as much as a step."""

_CM_PER_M = 100.0


@dataclass(frozen=True)
class CycleReport:
    """The result of one cycle, over all the logs that it presented.

    Attributes
    ----------
    epoch, cycle : int
        Counted from 0.
    phase : str
        What the cycle was for.
    hands_cm : tuple of float or None
        Mean error of each hand, in the robot's order, for an evaluated cycle.
    digest, stream_digest : str
        State and stream digest at the end of the cycle.
    ticks : int
        Ticks of the run so far.
    time_ns : int
        Stamp of the last one [ns].
    """

    epoch: int
    cycle: int
    phase: str
    hands_cm: tuple[float, ...] | None
    digest: str
    stream_digest: str
    ticks: int
    time_ns: int

    @property
    def error_cm(self) -> float | None:
        """Eq. (10): the mean over time and hands, for an evaluated cycle."""
        return None if self.hands_cm is None else sum(self.hands_cm) / len(self.hands_cm)


class Steps(NamedTuple):
    """Some steps as they were taken, each with its outputs from before its update.

    Attributes
    ----------
    stamps_ns : list of int, length n
        Stamps of the targets [ns].
    u : ndarray, shape (n, 3 hands)
        Hand positions that were its inputs [m].
    outputs : ndarray, shape (n, 3 hands + joints)
        Outputs of the network for each: next targets [m], joints [rad or m].
    """

    stamps_ns: list[int]
    u: Floats
    outputs: Floats


@dataclass
class _Counts:
    """Counts and errors of the run so far, all of it plain JSON."""

    ticks: int = 0
    steps: int = 0
    learned_steps: int = 0
    errors_cm: list[float] = field(default_factory=list)
    scored_m: list[list[float]] = field(default_factory=list)  # (T, hands) of the cycle under way


class LearningRun:
    """One run of the learner over a stream.

    Parameters
    ----------
    config : Settings
        The learner, of any rule; its outputs are made to fit the robot.
    robot : RobotConfig
        Joints, centres and kinematics.
    run : str
        Name of the run; phase markers of another are refused.
    pairing : PairingRule, optional
        Pairs that it learns from; the paper's if left out.
    on_steps : callable, optional
        Called with the steps, some at a time; the arrays are the run's own, to be read at once.

    Attributes
    ----------
    extent : JointExtent
        How far the joints moved in the steps of this process.
    """

    def __init__(
        self,
        config: Settings,
        robot: RobotConfig,
        run: str,
        *,
        pairing: PairingRule | None = None,
        on_steps: Callable[[Steps], None] | None = None,
    ) -> None:
        self._pairing = pairing or find_pairing(COMMANDED)
        output_centre = np.concatenate([robot.input_centre, robot.comfort])
        config = config.with_body(body_of(robot))
        self.robot = robot
        self.learner: OnlineLearner = make_learner(config, input_centre=robot.input_centre, output_centre=output_centre)
        self.counts = _Counts()
        self.extent = JointExtent(robot)
        self._run = run
        self._on_steps = on_steps
        self._kinematics = Kinematics(robot)
        self._stream = StreamDigest()
        self._pairs = self._pairing.pairs(robot)
        check = range_check(robot)
        self._joiner = TickJoiner(check, self._pairing.topics(robot.hand_names), check.poses)
        self._phase: Phase | None = None
        self._u = np.empty((PIECE, robot.input_centre.size))
        self._d = np.empty((PIECE, len(output_centre)))
        self._stamps_ns: list[int] = []  # of the inputs of the steps not yet handed to the kernel
        self._filled = 0
        self._time_ns = 0

    @property
    def phase(self) -> Phase | None:
        """The marker that the run follows at present."""
        return self._phase

    @property
    def between_ticks(self) -> bool:
        """Whether no tick is half-way in: a checkpoint holds complete ones only."""
        return self._joiner.idle

    @property
    def stream_digest(self) -> str:
        """Digest of the ticks and markers taken in so far."""
        return self._stream.hexdigest()

    def settle(self) -> None:
        """Take all steps that are complete now; they are taken in any case, and when does not enter the result."""
        self._flush()

    def so_far(self) -> CycleReport | None:
        """Return the report of the cycle under way, without errors; None before the first marker."""
        return None if self._phase is None else self._report(self._phase, None)

    def digest(self) -> str:
        """Return the state digest, with every complete tick in it."""
        self._flush()
        return state_digest(self.learner.state(), pending=self._pairs.pending)

    def begin_presentation(self, message: RecordedMessage) -> CycleReport | None:
        """Follow a phase marker; returns the report of the cycle that it ends, if it does.

        Raises
        ------
        MessageError
            If it is no marker, or of another run, or the presentation before it ends with an incomplete tick.
        """
        phase = _parse_marker(message)
        if phase.run != self._run:
            raise MessageError(f"{message.topic} #{message.sequence}: expected run {self._run}, found {phase.run[:64]}")
        if phase.epoch >= self.learner.config.epochs:
            expected = f"an epoch below {self.learner.config.epochs}"
            raise MessageError(f"{message.topic} #{message.sequence}: expected {expected}, found {phase.epoch}")
        report = self._end_presentation(phase)
        self._stream.update([message])
        self._pairs.begin()
        if self._phase is None or phase.epoch != self._phase.epoch:
            self.learner.begin_epoch(phase.epoch)
        self._phase = phase
        return report

    def feed(self, message: RecordedMessage) -> None:
        """Take one message; steps are taken as ticks come complete.

        Raises
        ------
        MessageError, JointError
            If it is not what it should be.
        """
        if self._phase is None:
            if is_measured(message.topic):  # robots publish their hands all the time
                return
            raise MessageError(f"{message.topic} #{message.sequence}: expected a phase marker before it, found none")
        for tick in self._joiner.feed(message):
            self._take(tick)

    def present(self, marker: RecordedMessage, presentation: Presentation) -> CycleReport | None:
        """Follow a phase marker and take all that it announces: `begin_presentation`, and `feed` for every message.

        Raises
        ------
        MessageError
            As `begin_presentation` does.
        """
        report = self.begin_presentation(marker)
        self._stream.extend(presentation.links)
        self.counts.ticks += len(presentation.links)
        for first in range(0, len(presentation.stamps_ns), PIECE):
            piece = slice(first, first + PIECE)
            self._step(presentation.stamps_ns[piece], presentation.u[piece], presentation.d[piece])
        self._time_ns = presentation.end_ns
        self._pairs.resume(presentation.pending)
        return report

    def end(self) -> CycleReport | None:
        """End the stream; returns the report of the last cycle."""
        return self._end_presentation(None)

    def controller(self, provenance: dict[str, Any]) -> Controller:
        """Return what is learned by now."""
        self._flush()
        return Controller.from_learner(
            self.learner,
            joints=self.robot.joints,
            robot_toml=self.robot.toml_text,
            robot_urdf=self.robot.urdf_text,
            pairs=self._pairing.name,
            pending=self._pairs.pending,
            provenance=provenance,
        )

    def snapshot(self) -> dict[str, Any]:
        """Return what a checkpoint needs beside the controller, as plain JSON."""
        self._flush()
        phase = None if self._phase is None else asdict(self._phase)
        return {"run": self._run, "phase": phase, "stream": self._stream.hexdigest(), "counts": asdict(self.counts)}

    def restore(self, controller: Controller, snapshot: dict[str, Any]) -> None:
        """Go on from a checkpoint.

        Raises
        ------
        ControllerError
            If the checkpoint is of another learner or robot, or is not one.
        """
        if controller.pairs != self._pairing.name:
            raise ControllerError(
                f"expected a checkpoint of pairs {self._pairing.name}, found one of {controller.pairs}; move it away"
            )
        if controller.config != self.learner.config or controller.robot_urdf != self.robot.urdf_text:
            raise ControllerError("the checkpoint is of another learner configuration or robot than the one asked for")
        try:
            self._phase = None if snapshot["phase"] is None else Phase(**snapshot["phase"])
            self._stream = StreamDigest(bytes.fromhex(snapshot["stream"]))
            self.counts = _Counts(**snapshot["counts"])
        except (KeyError, TypeError, ValueError) as error:
            raise ControllerError("expected a checkpoint of a learner, found a controller without one") from error
        self.learner.load_state(controller.state)
        self._pairs.resume(controller.pending)

    def _end_presentation(self, following: Phase | None) -> CycleReport | None:
        """Finish the presentation under way; a report if the cycle is over with it."""
        if self._phase is None:
            return None
        self._joiner.finish()
        self._flush()
        here = self._phase
        if following is not None and (following.epoch, following.cycle) == (here.epoch, here.cycle):
            return None
        hands_cm = None
        if self.counts.scored_m:
            hands_cm = tuple((np.array(self.counts.scored_m).mean(axis=0) * _CM_PER_M).tolist())
            self.counts.errors_cm.append(sum(hands_cm) / len(hands_cm))
            self.counts.scored_m = []
        return self._report(here, hands_cm)

    def _report(self, here: Phase, hands_cm: tuple[float, ...] | None) -> CycleReport:
        return CycleReport(
            here.epoch,
            here.cycle,
            here.phase,
            hands_cm,
            self.digest(),
            self.stream_digest,
            self.counts.ticks,
            self._time_ns,
        )

    def _take(self, tick: Tick) -> None:
        # Before the tick counts: an error leaves the run as it was.
        complete = self._pairs.fill(tick, self._u[self._filled], self._d[self._filled])
        self._stream.update(tick.records)
        self.counts.ticks += 1
        self._time_ns = tick.stamp_ns
        if complete:
            self._stamps_ns.append(self._pairs.stamp_ns)
            self._filled += 1
            if self._filled == PIECE:
                self._flush()

    def _flush(self) -> None:
        """Hand the steps that are complete to the kernel."""
        if self._filled:
            self._step(self._stamps_ns, self._u[: self._filled], self._d[: self._filled])
            self._stamps_ns = []
            self._filled = 0

    def _step(self, stamps_ns: list[int], u: Floats, d: Floats) -> None:
        """Predict, then update."""
        phase = self._phase.phase if self._phase else ""
        learning = phase == LEARN
        outputs = self.learner.step(u, d, learning=learning)
        if len(d):
            self.extent.take(d[:, u.shape[1] :])
        if phase == EVALUATE:
            errors = hand_errors(self._kinematics, outputs[:, u.shape[1] :], u)
            check_errors(errors)
            self.counts.scored_m += errors.tolist()
        if self._on_steps is not None:
            self._on_steps(Steps(stamps_ns, u, outputs))
        self.counts.steps += len(u)
        self.counts.learned_steps += len(u) if learning else 0


def _parse_marker(message: RecordedMessage) -> Phase:
    marker = decode(message.type, message.data)
    if not isinstance(marker, String):
        raise MessageError(f"{message.topic} #{message.sequence}: expected {String.TYPE}, found {message.type!r}")
    return Phase.from_message(marker)
