"""The learned controller at work: hand targets in, joint commands out, learning on if asked; no transport."""

import logging
from collections.abc import Callable
from enum import Enum, auto
from itertools import chain
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.insight import KnowsDeviation
from pipeline.learner.state import state_digest
from pipeline.robot.range_check import is_within, range_check
from pipeline.samples.pairing import COMMANDED
from pipeline.serving.clock_reset import LEAP_NS, RESTART_AFTER, StampOrder
from pipeline.serving.commands import Command, Commander
from pipeline.serving.config import ServingConfig
from pipeline.serving.inputs import JointsReader, TargetReader
from pipeline.serving.online_learning import OnlineLearning
from pipeline.serving.rejections import Rejection, Rejections, undecodable
from recorders.cdr.codec import decode_as, encode
from recorders.cdr.templates import pose_layout
from recorders.errors import ConfigError, MessageError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE, hand_target
from recorders.ticks.stamp_joiner import OpenTick, RejectionError, StampJoiner

logger = logging.getLogger(__name__)

MAX_OPEN = 64
"""Ticks that wait for a partner; whoever sends halves alone must not fill the memory."""


class _Step(Enum):
    """Work that is left on the learner before the next command."""

    WASHOUT = auto()  # a cycle begins: hold its first target
    TAKE = auto()  # take the step of the command that was sent
    NONE = auto()


_WASHOUT, _TAKE, _NONE = _Step  # the members of an Enum are slow to reach


class ServedController:
    """Answers every complete pair of targets with a joint command; not safe for several threads.

    A rejected message changes no state and produces no command: a joint command is a position, which the robot holds
    until the next. (The same again under the stamp of the rejected target would mean that this target was answered.)

    The command of step k is what the step's outputs will be, which u(k) and the state before it decide. The step itself
    is taken afterwards: when learning, once tick k+1 has brought d(k), before the command of step k+1, so that the
    prediction sent is the prediction scored; else in `settle`, so that no command waits for it. A tick that never gets
    its joints is as if it had not been: u(k) was indeed held on.

    A phase marker begins a new cycle, within which stamps start anew: the washout is made again. In a cycle marked for
    another phase than `learn` nothing is learned.

    A message stamped no later than the last tick answered is stale, and one stamped more than `LEAP_NS` later than the
    time that has passed since then is ahead; both are rejected, so that a single tick from nowhere moves no robot, and
    keeps no later one from doing so. But after `RESTART_AFTER` such ticks in a row, stale or ahead, each topic's stamps
    rising and no tick answered between them, their publisher's clock has begun anew, or the tick answered came from
    another clock: a new cycle begins with the next tick, which is reported the first time.

    Parameters
    ----------
    controller : Controller
        What was learned; a u that was pending when it was saved is forgotten.
    config : ServingConfig
        Learning, washout, what is reported.
    report : callable, optional
        Takes a line for the first message rejected for each reason, and for the first clock that began anew; must
        return at once, as a command may wait for it. They are logged if it is not given.

    Attributes
    ----------
    between_ticks : bool
        Whether no message waits for others of its tick.

    Raises
    ------
    ControllerError, RobotError
        If the controller is not for the hands and the joints of its own robot.
    ConfigError
        If it is to learn, and was trained with other pairs than a served controller sees.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        config: ServingConfig | None = None,
        report: Callable[[str], None] = logger.warning,
    ) -> None:
        self._controller = controller
        self._report = report
        self._config = config or ServingConfig()
        if self._config.learn and controller.pairs != COMMANDED:
            raise ConfigError(
                f"--learn: expected a controller of pairs {COMMANDED}, found one of {controller.pairs}; serve "
                "it without"
            )
        self._robot = robot = robot_of(controller)
        self._learner = learner = controller.learner()
        self._commander = Commander(learner, robot.joints, limits=np.array([robot.lower, robot.upper]))
        check, self._centres = range_check(robot), robot.centres.tolist()
        self._targets = tuple(TargetReader(centre, check, self._config.outside_m) for centre in self._centres)
        self._layout = pose_layout()
        self._usual_m = min(self._config.outside_m, *map(check.margin_m, self._centres))
        self._readers: tuple[TargetReader | JointsReader, ...] = self._targets
        self._topics: tuple[str, ...] = tuple(map(hand_target, robot.hand_names))
        if self._config.learn:
            self._readers, self._topics = (*self._readers, JointsReader(check)), (*self._topics, SAMPLE_JOINTS)
        self._indices = {topic: index for index, topic in enumerate(self._topics)}
        self._rejections = Rejections(report)
        self._ticks: StampJoiner[Any] = StampJoiner(self._topics, limit=MAX_OPEN, give_up=self._give_up)
        self._order = StampOrder(len(self._topics))
        self._online = OnlineLearning(learner, robot) if self._config.learn else None
        self._is_pair = len(self._topics) == 2 and not self._config.learn
        self._learning = self._config.learn
        self._accepted = 0
        self._restarted = False
        self._step = _NONE
        self.between_ticks = True
        self._warm_up()
        self._begin()

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics of which a tick consists."""
        return self._topics

    @property
    def pair(self) -> tuple[str, str] | None:
        """The topics of two targets that `answer_pair` can answer; None if a tick is of more or less than them."""
        return (self._topics[0], self._topics[1]) if self._is_pair else None

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are commanded."""
        return self._controller.joints

    @property
    def learning(self) -> bool:
        """Whether it learns at present."""
        return self._learning

    def take(self, record: RecordedMessage) -> Command | None:
        """Take in one message and return the command that it leads to, if any; `settle` can follow once it is sent.

        What cannot be used is rejected; other topics are passed over.

        Raises
        ------
        ConfigError
            If learning diverged: the controller is of no more use.
        """
        if self._step is _TAKE:
            self.settle()
        try:
            command = self._take(record)
        except RejectionError as error:
            self.reject(error.kind, str(error))
            command = None
        self.between_ticks = not self._ticks.open
        return command

    def answer_pair(self, left: bytes, right: bytes) -> tuple[int, bytes] | None:
        """Return stamp [ns] and command (CDR) for two poses (CDR), as `take` would; None if there is more to them.

        This is how nearly all ticks are answered: every call of a function counts here. None changes nothing, and
        `take` can have both.

        Raises
        ------
        ConfigError
            If learning diverged: the controller is of no more use.
        """
        if self._step is _TAKE:
            self.settle()
        if not self.between_ticks or self._step is _WASHOUT or not self._is_pair:
            return None
        pair = self._layout.read_pair(left, right)
        if pair is None:
            return None
        stamp, left_target, right_target = pair
        if not 0 < stamp - self._order.last_ns <= LEAP_NS:
            return None
        (left_centre, right_centre), usual = self._centres, self._usual_m
        if not (is_within(left_target, left_centre, usual) and is_within(right_target, right_centre, usual)):
            return None
        command = self._commander.command(stamp, *left_target, *right_target)
        self._step = _TAKE
        self._order.last_ns = stamp
        return stamp, command

    def settle(self) -> None:
        """Do what the last command did not have to wait for; whatever depends on it does it first, if need be.

        Raises
        ------
        ConfigError
            If the state is no longer finite: the controller is of no more use.
        """
        if self._step is not _TAKE:
            return
        self._step = _NONE
        self._accepted += 1
        self._order.note_answer()
        self._commander.finish(advance=self._online is None)

    def reject(self, reason: str, line: str) -> None:
        """Count a message that is not served, and remember the line that names why."""
        self._rejections.add(reason, line)

    def status(self) -> dict[str, Any]:
        """Return both digests, counts by reason and by joint, and the error of the predictions scored, as JSON has it.

        `digest` is the state digest now, pending u included; `hand_error_cm` is eq. (10) over the last predictions
        that met their d.
        """
        return self.status_later()()

    def status_later(self) -> Callable[[], dict[str, Any]]:
        """Return a function that computes the status of now, whatever happens to the controller meanwhile."""
        self.settle()
        clipped = zip(self._robot.joints, self._commander.clipped.tolist(), strict=True)
        figures = {
            "controller": self._controller.digest,
            "learning": self._learning,
            "accepted": self._accepted,
            "refused": self._rejections.counts(),
            "last_refusal": self._rejections.last,
            "outside": self._outside,
            "clipped": {name: count for name, count in clipped if count},
            "learned_steps": self._learned_steps,
        }
        if (deviation_cm := self._deviation_cm()) is not None:
            figures["deviation_cm"] = deviation_cm
        state, pending = self._learner.state(), self._pending
        error_cm = self._online.error_later() if self._online is not None else lambda: None
        return lambda: figures | {"digest": state_digest(state, pending), "hand_error_cm": error_cm()}

    def _deviation_cm(self) -> dict[str, float] | None:
        """Return how far from its target each hand may be after the last command, if the learner knows it."""
        if not (self._accepted and isinstance(self._learner, KnowsDeviation)):
            return None
        (deviations,) = self._learner.deviations(self._commander.u[np.newaxis]) * 100.0
        known = bool(np.isfinite(deviations).all())
        return dict(zip(self._robot.hand_names, deviations.tolist(), strict=True)) if known else None

    def counts(self) -> dict[str, int]:
        """Return what was counted so far; may be called from any thread."""
        rejected = self._rejections.counts()
        return {
            "accepted": self._accepted,
            "refused": sum(rejected.values()),
            "outside": self._outside,
            "learned_steps": self._learned_steps,
        } | {f"refused {reason}": count for reason, count in rejected.items()}

    def controller(self) -> Controller:
        """Return the controller as it is now, with its provenance."""
        self.settle()
        return Controller.from_learner(
            self._learner,
            joints=self._controller.joints,
            robot_toml=self._controller.robot_toml,
            robot_urdf=self._controller.robot_urdf,
            pairs=self._controller.pairs,
            pending=self._pending,
            provenance={
                **self._controller.provenance,
                "served_from": self._controller.digest,
                "learned_while_serving": self._learned_steps,
            },
        )

    @property
    def _outside(self) -> int:
        return sum(reader.outside for reader in self._targets)

    @property
    def _learned_steps(self) -> int:
        return 0 if self._online is None else self._online.steps

    @property
    def _pending(self) -> Floats:
        return np.empty(0) if self._online is None else self._online.pending

    def _follow(self, record: RecordedMessage) -> None:
        try:
            phase = Phase.from_message(decode_as(String, record.data))
        except MessageError as error:
            raise undecodable(record, error) from None
        self._learning = self._config.learn and phase.phase == LEARN
        self._begin()

    def _begin(self) -> None:
        """Begin a cycle: stamps start anew, nothing is pending, the next target is held for the washout."""
        self._ticks.clear()
        self._order.begin()
        if self._online is not None:
            self._online.begin()
        self._step = _WASHOUT

    def _begin_anew(self, stamp: int, reason: Rejection) -> None:
        """Begin a cycle without a marker, as stamps have."""
        if not self._restarted:
            self._report(
                f"{RESTART_AFTER} ticks in a row are {reason}, the last at {stamp} ns after one at "
                f"{self._order.last_ns} ns: a new cycle begins with the next"
            )
        self._restarted = True
        self._begin()
        self._order.begin(stamp)

    def _warm_up(self) -> None:
        """Load the kernels and the layouts of the messages, so that the first target waits for neither."""
        decode_as(PoseStamped, encode(PoseStamped(0, np.zeros(3))))
        self._commander.command(0, *chain.from_iterable(self._centres))
        self._controller.learner().predict([self._robot.input_centre])
        decode_as(JointState, encode(JointState(0, self._robot.joints, self._robot.comfort)))

    def _give_up(self, stamp: int, tick: OpenTick, _but: str) -> None:
        absent = ", ".join(self._ticks.absent(tick))
        for record, _ in filter(None, tick):
            self.reject(Rejection.NO_PARTNER, f"{record.topic}: {absent} at {stamp} ns never came")

    def _check_stamp(self, record: RecordedMessage, index: int, stamp: int) -> None:
        """Reject a stamp that cannot follow the last; after enough of them a clock has begun anew."""
        reason = self._order.rejection(stamp)
        if reason is None:
            return
        soon = "soon " if reason is Rejection.AHEAD else ""
        line = f"{record.topic}: expected a stamp {soon}after {self._order.last_ns} ns, found {stamp} ns"
        if self._order.goes_on(reason, index, stamp):
            self._begin_anew(stamp, reason)
        raise RejectionError(reason, line)

    def _take(self, record: RecordedMessage) -> Command | None:
        index = self._indices.get(record.topic)
        if index is None:
            if record.topic == SESSION_PHASE:
                self._follow(record)
            return None
        stamp, value = self._readers[index].read(record)
        self._check_stamp(record, index, stamp)
        parts = self._ticks.add(stamp, index, record, value)
        return None if parts is None else self._answer(stamp, parts)

    def _answer(self, stamp: int, parts: list[tuple[RecordedMessage, Any]]) -> Command:
        """Command what the next step's outputs will be."""
        targets = list(chain.from_iterable(value for _, value in parts[: len(self._targets)]))
        if self._step is _WASHOUT and self._config.washout_steps:
            self._learner.washout(np.array(targets), steps=self._config.washout_steps)
        if self._online is not None:
            self._online.take(stamp, parts, learning=self._learning)
        command = self._commander.command(stamp, *targets)
        self._step = _TAKE
        self._order.last_ns = stamp
        return Command(stamp, command, tuple(record for record, _ in parts))
