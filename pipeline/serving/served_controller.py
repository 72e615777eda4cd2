"""The learned controller at work: hand targets in, joint commands out, learning on if asked; no transport."""

import logging
from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.insight import KnowsDeviation
from pipeline.learner.state import state_digest
from pipeline.robot.range_check import is_within, range_check
from pipeline.samples.pairing import COMMANDED, PairingRule, find_pairing
from pipeline.serving.clock_reset import LEAP_NS, RESTART_AFTER
from pipeline.serving.commands import Command, Commander
from pipeline.serving.config import ServingConfig
from pipeline.serving.deviations import Deviations
from pipeline.serving.inputs import JointsReader, TargetReader
from pipeline.serving.online_learning import OnlineLearning
from pipeline.serving.output.speed_limiter import SpeedLimiter
from pipeline.serving.rejections import Rejection, Rejections, undecodable
from pipeline.serving.tick_stream import MAX_OPEN, MeasuredTicks, Parts, TickStream
from recorders.cdr.codec import decode_as, encode
from recorders.cdr.templates import pose_layout
from recorders.errors import MessageError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES, SESSION_PHASE, hand_target
from recorders.ticks.stamp_joiner import RejectionError

logger = logging.getLogger(__name__)


_NONE, _WASHOUT, _TAKE = range(3)
"""Work left on the learner before the next command: hold the first target of a cycle, or take the step of the last."""


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
    on_learned : callable, optional
        Takes the messages of each tick that was learned from apart from the targets; must return at once.
    on_deviation : callable, optional
        Takes stamp [ns] and predicted deviation of each hand [m], shape (hands,), of each command, once that is sent,
        if the learner knows it; must return at once.

    Attributes
    ----------
    between_ticks : bool
        Whether no message waits for others of its tick.

    Raises
    ------
    ControllerError, RobotError
        If the controller is not for the hands and the joints of its own robot.
    ConfigError
        If it is to learn, and commands depend on targets that its pairs do not have; or if it is to refuse targets
        beyond what was explored, and knows of none.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        config: ServingConfig | None = None,
        report: Callable[[str], None] = logger.warning,
        on_learned: Callable[[tuple[RecordedMessage, ...]], None] = lambda records: None,
        on_deviation: Callable[[int, Floats], None] = lambda stamp_ns, deviations: None,
    ) -> None:
        self._controller = controller
        self._report = report
        self._config = config or ServingConfig()
        self._robot = robot = robot_of(controller)
        adapts = self._config.learn and controller.pairs != COMMANDED
        self._learner = learner = (controller.adaptive() if adapts else controller).learner()
        self._config.check_offers(learner, pairs=controller.pairs)
        check, self._centres = range_check(robot), robot.centres.tolist()
        self._joints = JointsReader(check)
        speed = self._config.max_speed
        self._limiter = limiter = None if speed is None else SpeedLimiter(robot, speed)
        self._commander = Commander.of_robot(learner, robot, self._config.commands, limiter=limiter)
        self._targets = tuple(
            TargetReader(centre, check, self._config.outside_m, pose=check.poses.get(hand_target(name)))
            for centre, name in zip(self._centres, robot.hand_names, strict=True)
        )
        self._layout = pose_layout()
        self._usual_m = min(self._config.outside_m, *map(check.margin_m, self._centres))
        self._topics: tuple[str, ...] = tuple(map(hand_target, robot.hand_names))
        self._learned_topics: tuple[str, ...] = ()
        self._rejections = Rejections(report)
        self._on_learned = on_learned
        self._online: OnlineLearning | None = None
        self._measured: MeasuredTicks | None = None
        self._deviations: Deviations | None = None
        if isinstance(learner, KnowsDeviation):
            self._deviations = Deviations(learner, robot.hand_names, report=report, on_deviation=on_deviation)
        readers: tuple[TargetReader | JointsReader, ...] = self._targets
        if self._config.learn:
            pairing = find_pairing(controller.pairs)
            self._online = OnlineLearning(learner, robot, pairing)
            self._learned_topics = pairing.topics(robot.hand_names)
            if pairing.name == COMMANDED:
                readers, self._topics = (*readers, self._joints), self._learned_topics
            else:
                self._measured = MeasuredTicks(pairing, robot, reject=self.reject, on_choice=self._learn_otherwise)
        self._ticks = TickStream(self._topics, readers, reject=self.reject, restart=self._begin_anew)
        self._order = self._ticks.order
        of_two = len(self._topics) == len(self._targets) == 2 and not check.poses
        self._is_pair = of_two and not self._config.refuse_beyond and self._limiter is None
        self._learning = self._config.learn
        self._accepted = 0
        self._restarted = False
        self._step = _NONE
        self.between_ticks = True
        self._warm_up()
        self._begin()

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that it takes: of the ticks answered, of those learned, and of joints to start from."""
        start = () if self._limiter is None else (JOINT_STATES,)
        return tuple(dict.fromkeys((*self._topics, *self._learned_topics, *start)))

    @property
    def pair(self) -> tuple[str, str] | None:
        """The topics of two targets that `answer_pair` can answer; None if a tick is of more or less than them."""
        return (self._topics[0], self._topics[1]) if self._is_pair else None

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are commanded."""
        return self._controller.joints

    @property
    def state(self) -> str:
        """State in a word or two: serving or learning, and how far off the last command may be, if it knows."""
        return ("learning" if self._learning else "serving") + (self._deviations.text() if self._deviations else "")

    def joint_state(self) -> bytes:
        """Return the last command as a JointState (CDR), whatever the type of commands."""
        return self._commander.joint_state(self._order.last_ns)

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
        if self._measured is not None and self._accepted == MAX_OPEN and not self._learned_steps:
            absent = ", ".join(self._learned_topics)
            line = f"--learn: nothing is learned: {MAX_OPEN} commands were sent, and {absent} of one stamp never came"
            self._report(line)
        if self._deviations is not None:
            self._deviations.account(self._order.last_ns, self._commander.u)

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
        if self._deviations is not None:
            figures |= self._deviations.summary()
        figures |= {} if self._online is None else {"pairs": self._online.pairing.name}
        figures |= {} if self._limiter is None else {"limited": self._limiter.limited}
        state, pending = self._learner.state(), self._pending
        error_cm = self._online.error_later() if self._online is not None else lambda: None
        return lambda: figures | {"digest": state_digest(state, pending), "hand_error_cm": error_cm()}

    def counts(self) -> dict[str, int]:
        """Return what was counted so far; may be called from any thread."""
        rejected = self._rejections.counts()
        return {
            "accepted": self._accepted,
            "refused": sum(rejected.values()),
            "outside": self._outside,
            "learned_steps": self._learned_steps,
            **({} if self._deviations is None else {"beyond": self._deviations.beyond}),
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
                **({} if self._online is None else {"learned_from": self._online.pairing.name}),
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
        if self._limiter is not None:
            self._limiter.begin()
        self._ticks.begin()
        if self._measured is not None:
            self._measured.begin()
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
        self._commander.warm_up(*self._robot.input_centre.tolist())
        self._controller.learner().predict([self._robot.input_centre])
        decode_as(JointState, encode(JointState(0, self._robot.joints, self._robot.comfort)))

    def _take(self, record: RecordedMessage) -> Command | None:
        if record.topic == SESSION_PHASE:
            self._follow(record)
        if self._measured is not None:
            self._learn(self._measured.take(record))
        if self._limiter is not None:
            self._limiter.take(record, self._joints)
        if record.topic not in self._ticks:
            return None
        tick = self._ticks.take(record)
        return None if tick is None else self._answer(*tick)

    def _learn(self, ticks: list[tuple[int, Parts]]) -> None:
        """Learn from ticks that were measured, whatever is asked for meanwhile."""
        for stamp, parts in ticks:
            self._take_step(stamp, parts)
            self._on_learned(tuple(part for part, _ in parts))

    def _learn_otherwise(self, pairing: PairingRule) -> None:
        """Learn by the rule in place of the controller's from now on."""
        if self._online is not None:
            self._online.follow(pairing)
        absent = ", ".join(self._learned_topics)
        self._report(
            f"--learn: pairs {pairing.name}, as {absent} of one stamp never came; wrong zeros of joints are not mended"
        )

    def _take_step(self, stamp: int, parts: Parts) -> None:
        """Take the step that a tick completes."""
        learned = self._online is not None and self._online.take(stamp, parts, learning=self._learning)
        if learned and self._deviations is not None:
            self._deviations.learned()

    def _answer(self, stamp: int, parts: Parts) -> Command:
        """Command what the next step's outputs will be."""
        targets = list(chain.from_iterable(value for _, value in parts[: len(self._targets)]))
        if self._deviations is not None and self._config.refuse_beyond:
            self._deviations.refuse_beyond(stamp, np.array(targets))
        if self._step is _WASHOUT and self._config.washout_steps:
            self._learner.washout(np.array(targets), steps=self._config.washout_steps)
        if self._measured is None:
            self._take_step(stamp, parts)
        command = self._commander.command(stamp, *targets)
        self._step = _TAKE
        self._order.last_ns = stamp
        return Command(stamp, command, tuple(record for record, _ in parts))
