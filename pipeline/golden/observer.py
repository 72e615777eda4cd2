"""A learning run under observation: digests of messages, outputs and state after every tick."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.learner.controller import Controller
from pipeline.learner.rule import OnlineLearner, Settings
from pipeline.robot.recorded import offered_robot
from pipeline.samples.pairing import PairingRule
from pipeline.training.run import LearningRun
from recorders.cdr.codec import stamp_ns
from recorders.errors import ConfigError, JointError, MessageError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.protocol.stream import Offer
from replay.golden.recipe import EpochEnd, State, TickDigests


class _ObservedLearner:
    """A learner that keeps the outputs of its latest steps."""

    def __init__(self, learner: OnlineLearner) -> None:
        self._learner = learner
        self.outputs = b""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._learner, name)

    def step(self, u: ArrayLike, d: ArrayLike, *, learning: bool) -> Floats:
        outputs = self._learner.step(u, d, learning=learning)
        self.outputs = np.ascontiguousarray(outputs, "<f8").tobytes()
        return outputs


class ObservedRun:
    """A learning run that is looked at after every tick; the learner takes its steps one by one.

    Parameters
    ----------
    config : Settings
        The learner; its number of epochs is the stream's.
    pairing : PairingRule
        Pairs that it learns from.
    offer : Offer
        The description of the stream, the robot included.
    resume_after : int, optional
        After so many ticks a new learner goes on from a checkpoint.

    Raises
    ------
    LogError
        If the stream carries no robot.
    ConfigError
        From `run`: if the run is over before it is to be resumed.
    """

    def __init__(self, config: Settings, pairing: PairingRule, offer: Offer, resume_after: int | None) -> None:
        self._pairing = pairing
        self._config = config.fitted(epochs=offer.schedule["epochs"])
        self._offer = offer
        self._resume_after = resume_after
        self._names = {log.get("ticks_sha256", ""): str(log["name"]) for log in offer.logs}
        self._run, self._learner = self._begin()
        self._tick = 0

    def run(self, messages: Iterator[RecordedMessage]) -> Iterator[TickDigests | EpochEnd]:
        """Feed the whole stream."""
        for message in messages:
            if message.topic == SESSION_PHASE:
                yield from self._marker(message)
            else:
                with self._naming_the_log():
                    yield from self._feed(message)
        self._run.end()
        if self._resume_after is not None:
            raise ConfigError(
                f"golden case: expected to resume after a tick of the run, found {self._resume_after} of "
                f"{self._run.counts.ticks}"
            )
        if self._run.phase is not None:
            yield self._epoch_end(self._run.phase.epoch, self._learner.state())

    def _epoch_end(self, epoch: int, state: State) -> EpochEnd:
        return EpochEnd(epoch, state, self._learner.config.element_name)

    @contextmanager
    def _naming_the_log(self) -> Iterator[None]:
        try:
            yield
        except (MessageError, JointError) as error:
            raise type(error)(f"{self._log()}: {error}") from error

    def _log(self) -> str:
        """Name of the log that is presented; a session is one, whatever its markers name."""
        return "" if self._run.phase is None else self._names.get(self._run.phase.log, next(iter(self._names.values())))

    def _begin(self) -> tuple[LearningRun, _ObservedLearner]:
        robot = offered_robot(self._offer)
        run = LearningRun(self._config, robot, self._offer.run, pairing=self._pairing)
        learner = _ObservedLearner(run.learner)
        run.learner = cast(OnlineLearner, learner)
        return run, learner

    def _marker(self, message: RecordedMessage) -> Iterator[EpochEnd]:
        before, state = self._run.phase, self._learner.state()
        self._run.begin_presentation(message)
        self._tick = 0
        if before is not None and self._run.phase is not None and before.epoch != self._run.phase.epoch:
            yield self._epoch_end(before.epoch, state)

    def _feed(self, message: RecordedMessage) -> Iterator[TickDigests]:
        ticks = self._run.counts.ticks
        self._run.feed(message)
        if self._run.counts.ticks == ticks:
            return
        yield self._moment(message)
        self._tick += 1
        if self._resume_after is not None and self._run.counts.ticks >= self._resume_after and self._run.between_ticks:
            self._resume()

    def _moment(self, message: RecordedMessage) -> TickDigests:
        self._learner.outputs = b""
        state = bytes.fromhex(self._run.digest())  # hands the step to the kernel
        phase = self._run.phase
        if phase is None:
            raise ConfigError(f"{message.topic} #{message.sequence}: expected a phase marker before it, found none")
        return TickDigests(
            epoch=phase.epoch,
            cycle=phase.cycle,
            phase=phase.phase,
            log=self._names.get(phase.log, ""),
            tick=self._tick,
            stamp_ns=stamp_ns(message.type, message.data) or 0,
            stream=bytes.fromhex(self._run.stream_digest),
            outputs=hashlib.sha256(self._learner.outputs).digest(),
            state=state,
        )

    def _resume(self) -> None:
        """Go on with a new learner, from a checkpoint of the old one."""
        with TemporaryDirectory() as folder:
            path = Path(folder, "checkpoint.npz")
            snapshot = self._run.snapshot()
            self._run.controller({"checkpoint": snapshot}).save(path)
            checkpoint = Controller.load(path)
        self._resume_after = None
        self._run, self._learner = self._begin()
        self._run.restore(checkpoint, checkpoint.provenance["checkpoint"])
