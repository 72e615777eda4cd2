"""The learned controller at work: hand targets in, joint commands out, learning on if asked; no transport."""

import logging
import struct
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.errors import hand_errors
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.state import state_digest
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import OutOfRange, range_check
from pipeline.samples.pairing import COMMANDED
from pipeline.samples.rules.commanded import CommandedPairs
from pipeline.serving.calls import serving_calls
from pipeline.serving.clock_reset import RESTART_AFTER, StampOrder
from pipeline.serving.codec import Command, CommandEncoder, PoseReader, Position
from pipeline.serving.config import ServingConfig
from pipeline.serving.rejections import Refusal, RefusedError, undecodable, unusable, wrong_type
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ConfigError, JointError, MessageError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.ticks.joiner import Tick

logger = logging.getLogger(__name__)

Floats = NDArray[np.float64]

MAX_OPEN = 64  # ticks that wait for a partner; whoever sends halves alone must not fill the memory
_MAX_LINE = 300
_TARGETS = struct.Struct("=6d")  # fills an array several times as fast as an assignment
_SCORED = 64  # predictions over which the error in the status is taken: half a millisecond of kinematics


class ServedController:
    """Answers every complete pair of targets with a joint command; not safe for several threads.

    A refused message changes nothing and is answered by nothing: a joint command is a position, which the robot holds
    until the next. (To send it again under the stamp of the refused target would say that this target was answered.)

    The command of step k is what the step's outputs will be, which u(k) and the state before it decide. The step itself
    is taken afterwards: when learning, once tick k+1 has brought d(k), before the command of step k+1, so that the
    prediction sent is the prediction scored; else in `settle`, so that no command waits for it. A tick that never gets
    its joints is as if it had not been: u(k) was indeed held on.

    A phase marker begins a new cycle, within which stamps start anew: the washout is made again. In a cycle marked for
    another phase than `learn` nothing is learned.

    A message stamped no later than the last tick answered is stale, and one stamped more than `LEAP_NS` later than the
    time that has passed since then is ahead; both are refused, so that a single tick from nowhere moves no robot, and
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
        Takes a line for the first message refused for each reason, and for the first clock that began anew; must return
        at once, as a command may wait for it. They are logged if it is not given.

    Raises
    ------
    ControllerError, RobotError
        If the controller does not take two hand targets, or is not for the joints of its own robot.
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
        self._robot = robot_of(controller)
        self._learner = controller.learner()
        self._encoder = CommandEncoder(controller.joints)
        self._poses = PoseReader()
        self._topics = (LEFT_TARGET, RIGHT_TARGET) + ((SAMPLE_JOINTS,) if self._config.learn else ())
        self._places = {topic: place for place, topic in enumerate(self._topics)}
        self._centres = self._robot.centres.tolist()
        self._check = range_check(self._robot)
        self._pairs = CommandedPairs(controller.joints, len(self._robot.hands))
        self._row = np.empty((1, 6)), np.empty((1, 6 + len(controller.joints)))  # u(k), d(k) of the step to learn from
        self._calls = serving_calls(
            self._learner,
            self._encoder,
            limits=np.array([self._robot.lower, self._robot.upper]),
            centres=self._robot.input_centre,
            near_m=self._config.outside_m,
        )
        self._u_bytes = self._calls.u.data
        self._unsettled = False
        self._fresh: bool
        self._kinematics = Kinematics(self._robot) if self._config.learn else None
        self._scored: deque[tuple[Floats, Floats]] = deque(maxlen=_SCORED)
        self._refused: Counter[str] = Counter()
        self._last_refusal = ""
        self._accepted = self._outside = self._learned = 0
        self._learning = self._config.learn
        self._open: dict[int, tuple[list[Any], list[Any]]] = {}  # by stamp: values and records, each as in `topics`
        self._order = StampOrder(len(self._topics))
        self._restarted = False
        self._begin()
        self._warm_up()

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics of which a tick consists."""
        return self._topics

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are commanded."""
        return self._controller.joints

    @property
    def learning(self) -> bool:
        """Whether it learns at present."""
        return self._learning

    @property
    def between_ticks(self) -> bool:
        """Whether no message waits for others of its tick."""
        return not self._open

    def take(self, record: RecordedMessage) -> Command | None:
        """Take in one message and return the command that it leads to, if any; `settle` can follow once it is sent.

        What cannot be used is refused; other topics are passed over.

        Raises
        ------
        ConfigError
            If learning diverged: the controller is of no more use.
        """
        if self._unsettled:
            self.settle()
        place = self._places.get(record.topic)
        try:
            if place is None:
                if record.topic == SESSION_PHASE:
                    self._follow(record)
                return None
            stamp, value = self._read_joints(record) if place == 2 else self._read_target(record, place)
            values, records = self._find_tick(record, stamp, place)
        except RefusedError as error:
            self.refuse(error.reason, str(error))
            return None
        values[place], records[place] = value, record
        return None if None in records else self._answer(stamp, values, records)

    def answer_usual(self, left: bytes, right: bytes) -> tuple[int, bytes] | None:
        """Return stamp [ns] and command (CDR) for two poses (CDR), as `take` would; None if they are out of the usual.

        None changes nothing: `take` can have them.

        Raises
        ------
        ConfigError
            If learning diverged: the controller is of no more use.
        """
        if self._unsettled:
            self.settle()
        if self._open or self._fresh or self._config.learn:
            return None
        stamp = self._calls.answer(left, right, self._order.last_ns)
        if stamp < 0 or self._order.is_ahead(stamp):
            return None
        self._unsettled = True
        self._order.last_ns = stamp
        return stamp, self._encoder.encoded()

    def settle(self) -> None:
        """Do what the last command did not have to wait for; whatever depends on it does it first, if need be.

        Raises
        ------
        ConfigError
            If the state is no longer finite: the controller is of no more use.
        """
        if not self._unsettled:
            return
        self._unsettled = False
        self._accepted += 1
        self._order.note_answer()
        if status := self._calls.settle(advance=not self._config.learn):
            self._calls.check(status)

    def refuse(self, reason: Refusal, line: str) -> None:
        """Count a message that is not served, and keep the line that says why."""
        self._refused[reason.value] += 1
        # The text may quote what came from the network.
        self._last_refusal = "".join(c if c.isprintable() else "?" for c in line[:_MAX_LINE])
        if self._refused[reason.value] == 1:
            self._report(f"refused, {reason.value}: {self._last_refusal}")

    def status(self) -> dict[str, Any]:
        """Return both digests, counts by reason and by joint, and the error of the predictions scored, as JSON has it.

        `digest` is the state digest now, pending u included; `hand_error_cm` is eq. (10) over the last predictions
        that met their d.
        """
        return self.status_later()()

    def status_later(self) -> Callable[[], dict[str, Any]]:
        """Return what works out the status of now, whatever happens to the controller meanwhile."""
        self.settle()
        clipped = zip(self._robot.joints, self._calls.clipped.tolist(), strict=True)
        figures = {
            "controller": self._controller.digest,
            "learning": self._learning,
            "accepted": self._accepted,
            "refused": dict(self._refused),
            "last_refusal": self._last_refusal,
            "outside": self._outside,
            "clipped": {name: count for name, count in clipped if count},
            "learned_steps": self._learned,
        }
        state, pending, scored = self._learner.state(), self._pairs.pending, tuple(self._scored)
        return lambda: figures | {"digest": state_digest(state, pending), "hand_error_cm": self._error_cm(scored)}

    def counts(self) -> dict[str, int]:
        """Return what was counted so far; may be called from any thread."""
        refused = dict(self._refused)
        by_reason = {f"refused {reason}": count for reason, count in refused.items()}
        return {
            "accepted": self._accepted,
            "refused": sum(refused.values()),
            "outside": self._outside,
            "learned_steps": self._learned,
        } | by_reason

    def controller(self) -> Controller:
        """Return the controller as it is now, with what it was made from."""
        self.settle()
        return Controller.from_learner(
            self._learner,
            joints=self._controller.joints,
            robot_toml=self._controller.robot_toml,
            robot_urdf=self._controller.robot_urdf,
            pairs=self._controller.pairs,
            pending=self._pairs.pending,
            provenance={
                **self._controller.provenance,
                "served_from": self._controller.digest,
                "learned_while_serving": self._learned,
            },
        )

    def _follow(self, record: RecordedMessage) -> None:
        try:
            phase = Phase.from_message(decode_as(String, record.data))
        except MessageError as error:
            raise undecodable(record, error) from None
        self._learning = self._config.learn and phase.phase == LEARN
        self._begin()

    def _begin(self) -> None:
        """Begin a cycle: stamps start anew, nothing is pending, the next target is held for the washout."""
        self._open.clear()
        self._pairs.begin()
        self._order.begin()
        self._fresh = True

    def _begin_anew(self, stamp: int, reason: Refusal) -> None:
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
        self._calls.u[:] = self._robot.input_centre
        self._calls.look_ahead()
        pose = encode(PoseStamped(0, np.zeros(3)))
        self._calls.answer(pose, pose, -1)
        self._controller.learner().predict([self._calls.u])
        decode_as(JointState, encode(JointState(0, self._robot.joints, self._robot.comfort)))

    def _read_target(self, record: RecordedMessage, hand: int) -> tuple[int, Position]:
        if record.type != PoseStamped.TYPE:
            raise wrong_type(record, PoseStamped.TYPE)
        try:
            stamp, position = self._poses.read(record.data)
        except MessageError as error:
            raise undecodable(record, error) from None
        (x, y, z), (x_0, y_0, z_0), usual = position, self._centres[hand], self._config.outside_m
        if not (abs(x - x_0) <= usual and abs(y - y_0) <= usual and abs(z - z_0) <= usual):  # nor is NaN usual
            self._check_far(record, position)
        return stamp, position

    def _check_far(self, record: RecordedMessage, position: Position) -> None:
        try:
            self._check.check_target(position)
        except OutOfRange as error:
            raise unusable(record, error) from None
        self._outside += 1

    def _read_joints(self, record: RecordedMessage) -> tuple[int, JointState]:
        if record.type != JointState.TYPE:
            raise wrong_type(record, JointState.TYPE)
        try:
            joints = decode_as(JointState, record.data)
            self._check.check_joints(joints)
        except JointError as error:
            raise RefusedError(Refusal.WRONG_JOINTS, f"{record.topic}: {error}") from None
        except OutOfRange as error:
            raise unusable(record, error) from None
        except MessageError as error:
            raise undecodable(record, error) from None
        return joints.stamp_ns, joints

    def _find_tick(self, record: RecordedMessage, stamp: int, place: int) -> tuple[list[Any], list[Any]]:
        if (reason := self._order.refusal(stamp)) is not None:
            soon = "soon " if reason is Refusal.AHEAD else ""
            line = f"{record.topic}: expected a stamp {soon}after {self._order.last_ns} ns, found {stamp} ns"
            if self._order.goes_on(reason, place, stamp):
                self._begin_anew(stamp, reason)
            raise RefusedError(reason, line)
        tick = self._open.get(stamp)
        if tick is None:
            if len(self._open) >= MAX_OPEN:
                self._drop(next(iter(self._open)))  # by arrival: a stamp far ahead must not push out what is due
            nothing = [None] * len(self._topics)
            tick = self._open[stamp] = nothing, nothing.copy()
        elif tick[1][place] is not None:
            raise RefusedError(Refusal.REPEATED, f"{record.topic}: a second message at {stamp} ns")
        return tick

    def _drop_before(self, stamp: int) -> None:
        for older in [other for other in self._open if other < stamp]:
            self._drop(older)

    def _drop(self, stamp: int) -> None:
        """Give up a tick that waits."""
        _, records = self._open.pop(stamp)
        absent = ", ".join(topic for topic, record in zip(self._topics, records, strict=True) if record is None)
        for record in filter(None, records):
            self.refuse(Refusal.NO_PARTNER, f"{record.topic}: {absent} at {stamp} ns never came")

    def _answer(self, stamp: int, values: list[Any], records: list[Any]) -> Command:
        del self._open[stamp]
        if self._open:
            self._drop_before(stamp)
        position = (*values[0], *values[1])
        if self._fresh and self._config.washout_steps:
            self._learner.washout(np.array(position), steps=self._config.washout_steps)
        if self._config.learn:
            self._complete_step(stamp, values, records)
        self._fresh = False
        return self._command(stamp, position, tuple(records))

    def _command(self, stamp: int, position: Position, records: tuple[RecordedMessage, ...]) -> Command:
        """Command what the next step's outputs will be."""
        _TARGETS.pack_into(self._u_bytes, 0, *position)
        self._calls.look_ahead()
        self._unsettled = True
        self._order.last_ns = stamp
        return Command(stamp, self._encoder.encode(stamp), records)

    def _complete_step(self, stamp: int, values: list[Any], records: list[Any]) -> None:
        """Take the step that this tick completes: predict, score, then update."""
        left, right, joints = values
        tick = Tick(stamp, (np.array(left), np.array(right)), joints, tuple(records))
        u, d = self._row
        if self._pairs.fill(tick, u[0], d[0]):
            outputs = self._learner.step(u, d, learning=self._learning)
            self._scored.append((u[0].copy(), outputs[0, 6:]))
            self._learned += self._learning

    def _error_cm(self, scored: tuple[tuple[Floats, Floats], ...]) -> float | None:
        if self._kinematics is None or not scored:
            return None
        targets, postures = (np.array(column) for column in zip(*scored, strict=True))
        return float(hand_errors(self._kinematics, postures, targets).mean() * 100.0)
