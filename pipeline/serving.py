"""The learned controller at work: hand targets in, joint commands out, learning on if asked; no transport."""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.controller import Controller
from pipeline.evaluation import WASHOUT_STEPS, hand_errors
from pipeline.foresight import ForesightLearner
from pipeline.kinematics import Kinematics
from pipeline.learner import state_digest
from pipeline.robot import parse_robot
from pipeline.samples import CommandedPairs
from pipeline.serving_codec import CommandEncoder, PoseReader, Position
from recorders.cdr import decode_as, encode
from recorders.errors import ConfigError, ControllerError, JointError, MessageError
from recorders.messages import JointState, PoseStamped, String
from recorders.phase import LEARN, Phase
from recorders.records import Stamped
from recorders.ticks import JointMap, Tick
from recorders.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE

Floats = NDArray[np.float64]

MAX_DISTANCE_M = 10.0
"""A target farther than this from the centre of its pattern is no target; far larger numbers overflow the network."""

MAX_OPEN = 64  # ticks that wait for a partner; whoever sends halves alone must not fill the memory
_MAX_LINE = 300
_SCORED = 64  # predictions over which the error in the status is taken: half a millisecond of kinematics


class Refusal(StrEnum):
    """Why a message is refused; the last good command is held."""

    STALE = "stale"  # not newer than the last targets that were accepted
    REPEATED = "repeated"  # the same topic and stamp as one that waits for its partner
    WRONG_TYPE = "wrong type"
    UNDECODABLE = "undecodable"
    TOO_LARGE = "too large"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    WRONG_JOINTS = "wrong joints"
    NO_PARTNER = "no partner"  # the rest of its tick had not come when a newer tick was complete


@dataclass(frozen=True)
class ServingConfig:
    """How a controller is served.

    Parameters
    ----------
    learn : bool
        Whether to go on learning. A command then waits for `/sample/joint_states` of its tick.
    washout_steps : int
        The first target of a cycle is held this long beforehand, as an evaluation does; 0 goes on from the
        controller's own state.
    outside_m : float
        Targets farther than this from the centre of their pattern are counted, and served [m].

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    learn: bool = False
    washout_steps: int = WASHOUT_STEPS
    outside_m: float = 0.25  # the robot reaches all of the square of this half width

    def __post_init__(self) -> None:
        if self.washout_steps < 0 or not 0.0 < self.outside_m <= MAX_DISTANCE_M:
            raise ConfigError(
                f"expected washout_steps of at least 0 and outside_m up to {MAX_DISTANCE_M:g} m, "
                f"found {self.washout_steps} and {self.outside_m:g}"
            )


class Command(NamedTuple):
    """One joint command and what it answers.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the targets, and of the command [ns].
    data : bytes
        The command, a JointState as CDR.
    answered : tuple of Stamped
        The messages of the tick: left target, right target and, when learning, the joints.
    """

    stamp_ns: int
    data: bytes
    answered: tuple[Stamped, ...]


class ServedController:
    """Answers every complete pair of targets with a joint command; not safe for several threads.

    A refused message changes nothing and is answered by nothing: a joint command is a position, which the robot holds
    until the next. (To send it again under the stamp of the refused target would say that this target was answered.)

    Step k runs forward at t_k, and that prediction is the command. When learning, the step is taken again from the same
    state once tick k+1 has brought d(k), now with its update, before step k+1 runs forward: the prediction sent is the
    prediction scored. A tick that never gets its joints is as if it had not been: u(k) was indeed held on.

    A phase marker begins a new cycle, within which stamps start anew: the washout is made again. In a cycle marked for
    another phase than `learn` nothing is learned.

    Parameters
    ----------
    controller : Controller
        What was learned; a u that was pending when it was saved is forgotten.
    config : ServingConfig
        Learning, washout, what is reported.
    say : callable
        Told a line of the first message refused for each reason.

    Raises
    ------
    ControllerError, RobotError
        If the controller does not take two hand targets, or is not for the joints of its own robot.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        config: ServingConfig | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._controller = controller
        self._say = say
        self._config = config or ServingConfig()
        self._robot = parse_robot(controller.robot_toml, controller.robot_urdf)
        if self._robot.joints != controller.joints or controller.config.inputs != 6:
            raise ControllerError(
                f"expected a controller of two hands and the joints of {self._robot.name}, "
                f"found {controller.config.inputs} inputs and joints {', '.join(controller.joints)}"
            )
        self._learner = ForesightLearner(controller)
        self._encoder = CommandEncoder(controller.joints)
        self._poses = PoseReader()
        self._topics = (LEFT_TARGET, RIGHT_TARGET) + ((SAMPLE_JOINTS,) if self._config.learn else ())
        self._places = {topic: place for place, topic in enumerate(self._topics)}
        self._centres = self._robot.left_centre.tolist(), self._robot.right_centre.tolist()
        self._joints = JointMap(controller.joints)
        self._pairs = CommandedPairs(controller.joints)
        self._row = np.empty((1, 6)), np.empty((1, 6 + len(controller.joints)))  # u(k), d(k)
        self._kinematics = Kinematics(self._robot) if self._config.learn else None
        self._scored: deque[tuple[Floats, Floats]] = deque(maxlen=_SCORED)
        self._refused: Counter[str] = Counter()
        self._clipped = np.zeros(len(controller.joints), dtype=np.int64)
        self._last_refusal = ""
        self._accepted = self._outside = self._learned = 0
        self._learning = self._config.learn
        self._open: dict[int, list[Any]] = {}  # by stamp; each place in `topics` takes (value, record)
        self._begin()
        self._warm_up()

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics of which a tick consists."""
        return self._topics

    def take(self, record: Stamped) -> Command | None:
        """Take in one message and return the command that it leads to, if any.

        What cannot be used is refused; other topics are passed over.

        Raises
        ------
        ConfigError
            If learning diverged: the controller is of no more use.
        """
        try:
            if record.topic == SESSION_PHASE:
                self._follow(record)
                return None
            place = self._places.get(record.topic)
            if place is None:
                return None
            stamp, value = self._read_joints(record) if place == 2 else self._read_target(record, place)
            tick = self._find_tick(record, stamp, place)
        except _RefusedError as error:
            self.refuse(error.reason, str(error))
            return None
        tick[place] = value, record
        return None if None in tick else self._answer(stamp, tick)

    def refuse(self, reason: Refusal, line: str) -> None:
        """Count a message that is not served, and keep the line that says why."""
        self._refused[reason.value] += 1
        # The text may quote what came from the network.
        self._last_refusal = "".join(c if c.isprintable() else "?" for c in line[:_MAX_LINE])
        if self._refused[reason.value] == 1:
            self._say(f"refused, {reason.value}: {self._last_refusal}")

    def status(self) -> dict[str, Any]:
        """Return both digests, counts by reason and by joint, and the error of the predictions scored, as JSON has it.

        `digest` is the state digest now, pending u included; `hand_error_cm` is eq. (10) over the last predictions
        that met their d.
        """
        return {
            "controller": self._controller.digest,
            "digest": state_digest(self._learner.state(), self._pairs.pending),
            "learning": self._learning,
            "accepted": self._accepted,
            "refused": dict(self._refused),
            "last_refusal": self._last_refusal,
            "outside": self._outside,
            "clipped": {
                name: count for name, count in zip(self._robot.joints, self._clipped.tolist(), strict=True) if count
            },
            "learned_steps": self._learned,
            "hand_error_cm": self._error_cm(),
        }

    def controller(self) -> Controller:
        """Return the controller as it is now, with what it was made from."""
        return Controller.from_learner(
            self._learner,
            joints=self._controller.joints,
            robot_toml=self._controller.robot_toml,
            robot_urdf=self._controller.robot_urdf,
            pending=self._pairs.pending,
            provenance={
                **self._controller.provenance,
                "served_from": self._controller.digest,
                "learned_while_serving": self._learned,
            },
        )

    def _follow(self, record: Stamped) -> None:
        try:
            phase = Phase.from_message(decode_as(String, record.data))
        except MessageError as error:
            raise _undecodable(record, error) from None
        self._learning = self._config.learn and phase.phase == LEARN
        self._begin()

    def _begin(self) -> None:
        """Begin a cycle: stamps start anew, nothing is pending, the next target is held for the washout."""
        self._open.clear()
        self._pairs.begin()
        self._last_stamp = -1
        self._fresh = True

    def _warm_up(self) -> None:
        """Load the kernel and the layouts of the messages, so that the first target waits for neither."""
        self._learner.foresee(tuple(self._robot.input_centre.tolist()))
        decode_as(JointState, encode(JointState(0, self._robot.joints, self._robot.comfort)))

    def _read_target(self, record: Stamped, hand: int) -> tuple[int, Position]:
        if record.type != PoseStamped.TYPE:
            raise _wrong_type(record, PoseStamped.TYPE)
        try:
            stamp, position = self._poses.read(record.data)
        except MessageError as error:
            raise _undecodable(record, error) from None
        centre = self._centres[hand]
        distance = max(abs(position[0] - centre[0]), abs(position[1] - centre[1]), abs(position[2] - centre[2]))
        # A NaN fails every comparison, but whether `max` returns it depends on its place.
        if not (distance <= MAX_DISTANCE_M and isfinite(sum(position))):
            raise _unusable(record, position, f"within {MAX_DISTANCE_M:g} m of the pattern")
        if distance > self._config.outside_m:
            self._outside += 1
        return stamp, position

    def _read_joints(self, record: Stamped) -> tuple[int, JointState]:
        if record.type != JointState.TYPE:
            raise _wrong_type(record, JointState.TYPE)
        try:
            joints = decode_as(JointState, record.data)
            positions = self._joints.positions(joints)
        except JointError as error:
            raise _RefusedError(Refusal.WRONG_JOINTS, f"{record.topic}: {error}") from None
        except MessageError as error:
            raise _undecodable(record, error) from None
        lower, upper = self._robot.lower, self._robot.upper
        if not (np.abs(positions - (lower + upper) / 2.0) <= 1.5 * (upper - lower)).all():  # one range beyond a limit
            raise _unusable(record, positions.tolist(), "near the joints' limits")
        return joints.stamp_ns, joints

    def _find_tick(self, record: Stamped, stamp: int, place: int) -> list[Any]:
        if stamp <= self._last_stamp:
            line = f"{record.topic}: expected a stamp after {self._last_stamp} ns, found {stamp} ns"
            raise _RefusedError(Refusal.STALE, line)
        tick = self._open.get(stamp)
        if tick is None:
            if len(self._open) >= MAX_OPEN:
                self._drop(next(iter(self._open)))  # by arrival: a stamp far ahead must not push out what is due
            tick = self._open[stamp] = [None] * len(self._topics)
        elif tick[place] is not None:
            raise _RefusedError(Refusal.REPEATED, f"{record.topic}: a second message at {stamp} ns")
        return tick

    def _drop_before(self, stamp: int) -> None:
        for older in [other for other in self._open if other < stamp]:
            self._drop(older)

    def _drop(self, stamp: int) -> None:
        """Give up a tick that waits."""
        tick = self._open.pop(stamp)
        absent = ", ".join(topic for topic, part in zip(self._topics, tick, strict=True) if part is None)
        for part in tick:
            if part is not None:
                self.refuse(Refusal.NO_PARTNER, f"{part[1].topic}: {absent} at {stamp} ns never came")

    def _answer(self, stamp: int, parts: list[Any]) -> Command:
        del self._open[stamp]
        if self._open:
            self._drop_before(stamp)
        u = (*parts[0][0], *parts[1][0])
        if self._fresh and self._config.washout_steps:
            self._learner.washout(u, steps=self._config.washout_steps)
        if self._config.learn:
            self._complete_step(stamp, parts)
            positions = self._learner.foresee(u)[6:]
        else:
            positions = self._learner.answer(u)[6:]
        self._fresh = False
        self._last_stamp = stamp
        self._accepted += 1
        return Command(stamp, self._encoder.encode(stamp, self._limited(positions)), tuple([part[1] for part in parts]))

    def _complete_step(self, stamp: int, parts: list[Any]) -> None:
        """Take the step that this tick completes: predict, score, then update."""
        (left, right, joints), records = zip(*parts, strict=True)
        tick = Tick(stamp, np.array(left), np.array(right), joints, records)
        u, d = self._row
        if self._pairs.fill(tick, u[0], d[0]):
            outputs = self._learner.step(u, d, learning=self._learning)
            self._scored.append((u[0].copy(), outputs[0, 6:]))
            self._learned += self._learning

    def _limited(self, positions: Floats) -> Floats:
        within = np.minimum(np.maximum(positions, self._robot.lower), self._robot.upper)
        if within.tobytes() != positions.tobytes():
            self._clipped += within != positions
        return within

    def _error_cm(self) -> float | None:
        if self._kinematics is None or not self._scored:
            return None
        targets, postures = (np.array(column) for column in zip(*self._scored, strict=True))
        return float(hand_errors(self._kinematics, postures, targets).mean() * 100.0)


class _RefusedError(MessageError):
    """A message is not served."""

    def __init__(self, reason: Refusal, line: str) -> None:
        super().__init__(line)
        self.reason = reason


def _undecodable(record: Stamped, error: MessageError) -> _RefusedError:
    return _RefusedError(Refusal.UNDECODABLE, f"{record.topic}: {error}")


def _wrong_type(record: Stamped, expected: str) -> _RefusedError:
    return _RefusedError(Refusal.WRONG_TYPE, f"{record.topic}: expected {expected}, found {record.type!r:.80}")


def _unusable(record: Stamped, values: Sequence[float], expected: str) -> _RefusedError:
    if not all(map(isfinite, values)):
        return _RefusedError(Refusal.NOT_FINITE, f"{record.topic}: expected finite numbers, found {values}")
    return _RefusedError(Refusal.OUT_OF_RANGE, f"{record.topic}: expected numbers {expected}, found {values}")
