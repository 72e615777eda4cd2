"""Drive of a robot by targets: what is asked of the hands at every state that the robot reports; no transport."""

import threading
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from pipeline.arrays import Floats
from pipeline.browser.session.figures import Figures, Mean, Round, RoundFigures, TickError
from pipeline.browser.session.motion_loop import MotionLoop
from pipeline.browser.session.moving_targets import MovingTargets
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, to_rows
from pipeline.robot.kinematics import Kinematics

TICK_NS = 20_000_000
"""Least time from tick to tick [ns]: 50 Hz."""

_EARLY_NS = TICK_NS // 10  # by so much a state may be early, and make a tick nevertheless
_LONGEST_S = 0.1  # however long no state came, targets go on as after this time
_MOST_UNANSWERED = 100  # ticks, 2 s at 50 Hz: a controller is asked each 0.5 s to 1 s, and one reply may be lost
_PATH = 300  # points of each path that is shown: 6 s at 50 Hz


class Mode(StrEnum):
    """Source of the targets."""

    AT_REST = "at rest"  # nothing is asked of the robot
    HANDLES = "handles"
    MOTION = "motion"
    LENT = "exploring by itself"  # somebody else moves the robot


@dataclass(frozen=True, eq=False)
class Tick:
    """Targets that go out under the stamp of a state of the robot.

    Attributes
    ----------
    stamp_ns : int
        Of the state [ns].
    rows : ndarray
        Targets by row, shape (hands, 3 or 7).
    begins : bool
        Whether the robot's clock began anew before.
    """

    stamp_ns: int
    rows: Floats
    begins: bool


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What is so at an instant.

    Attributes
    ----------
    states : int
        States that the robot has reported so far.
    time_ns : int
        The robot's time [ns].
    q : ndarray
        Its joints [rad or m], shape (n,).
    hands, targets, wanted : ndarray
        Hands as they are, targets as they are asked for, and where these go, by row, shape (hands, 3 or 7).
    mode : Mode
        Source of the targets.
    loop : MotionLoop or None
        Motion that is gone through, or was the last.
    is_answered : bool
        Whether a controller answers the targets with commands.
    error : TickError or None
        Of the last tick; None while no controller answers.
    mean : Mean
        Mean error since it was begun anew.
    """

    states: int
    time_ns: int
    q: Floats
    hands: Floats
    targets: Floats
    wanted: Floats
    mode: Mode
    loop: MotionLoop | None
    is_answered: bool
    error: TickError | None
    mean: Mean


class Drive:
    """Targets for a robot, one tick with each state that it reports, at most at 50 Hz, in the robot's own time.

    States come on one thread and what is wanted from others.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self.robot = robot
        self._kinematics = Kinematics(robot)
        self._figures = Figures(Kinematics(robot))
        self._rounds = RoundFigures()
        self._lock = threading.RLock()
        self._mode = Mode.AT_REST
        self._loop: MotionLoop | None = None
        self._gliding = False  # on the way to where the motion is
        self._followed: MotionLoop | None = None  # by the last tick
        self._lent = False
        self._q = robot.comfort
        self._hands = self._rows(robot.comfort)
        self._moving = MovingTargets(robot, self._hands)
        self._last: Tick | None = None
        self._states = self._time_ns = 0
        self._unanswered = _MOST_UNANSWERED  # ticks since a controller was seen to answer
        self._is_answered = False  # the last tick
        self._reached: deque[Floats] = deque(maxlen=_PATH)
        self._asked: deque[Floats] = deque(maxlen=_PATH)

    def take(self, stamp_ns: int, q: Floats) -> Tick | None:
        """Take a state of the robot, joints (n,) [rad or m], and return the tick that answers it, if one is due."""
        with self._lock:
            anew = stamp_ns < self._time_ns
            self._states, self._time_ns, self._q = self._states + 1, stamp_ns, q
            self._hands = self._rows(q)
            idle = self._lent or self._mode is Mode.AT_REST
            if anew or idle:
                self._last = None
            if idle:
                self._moving = MovingTargets(self.robot, self._hands)
                return None
            if self._last is None:
                return self._first(stamp_ns)
            passed_ns = stamp_ns - self._last.stamp_ns
            if passed_ns < TICK_NS - _EARLY_NS:
                return None
            was_answered, self._is_answered = self._is_answered, self._unanswered < _MOST_UNANSWERED
            self._unanswered += 1
            if self._is_answered and not was_answered:
                return self._first(stamp_ns)
            self._count(stamp_ns, passed_ns)
            return self._tick(stamp_ns, min(passed_ns * 1e-9, _LONGEST_S), begins=False)

    def answer(self) -> None:
        """Note that a controller answers targets; what none answers is no error of any controller."""
        with self._lock:
            self._unanswered = 0

    def move_hand(self, place: int, row: Floats) -> None:
        """Want a hand elsewhere, by row; what moves by itself stops, the other hands stay where they are asked to.

        A row that is not finite changes nothing.
        """
        if not np.isfinite(row).all():
            return
        with self._lock:
            if self._mode is not Mode.HANDLES:
                self.hold()
            self._moving.wanted[place] = row

    def hold(self) -> None:
        """Hold the targets where they are."""
        with self._lock:
            self._mode = Mode.HANDLES
            self._moving.wanted = self._moving.rows.copy()

    def rest(self) -> None:
        """Ask nothing of the robot any more."""
        with self._lock:
            self._mode = Mode.AT_REST

    def go_through(self, motion: Motion) -> MotionLoop:
        """Go through a motion, again and again."""
        with self._lock:
            self._loop, self._mode, self._gliding = MotionLoop(motion), Mode.MOTION, True
            return self._loop

    def begin(self, motion: Motion) -> None:
        """Go through a motion if nothing is asked of the robot yet."""
        with self._lock:
            if self._mode is Mode.AT_REST and not self._lent:
                self.go_through(motion)

    def seek(self, at_s: float) -> None:
        """Go to a place of the motion [s], and stay there while it is paused."""
        with self._lock:
            if self._loop is not None:
                self._loop.seek(at_s)
                self._mode, self._gliding = Mode.MOTION, True

    def lend(self, *, lent: bool) -> None:
        """Let somebody else move the robot, or go on with what is wanted by now."""
        with self._lock:
            self._lent = lent

    def begin_figures(self) -> None:
        """Begin the mean error anew."""
        with self._lock:
            self._figures.begin()

    def change_controller(self, controller: str) -> None:
        """Begin the figures of a controller that leads from now on."""
        with self._lock:
            self._figures.begin()
            self._rounds.begin(controller)

    def forget_controller(self, controller: str) -> None:
        """Forget the rounds of a controller."""
        with self._lock:
            self._rounds.forget(controller)

    def rounds(self) -> dict[str, Round]:
        """Return the rounds through the motion of now by controller; nothing where there is none."""
        with self._lock:
            return {} if self._loop is None else self._rounds.of(self._loop)

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the last tick [ns], None before the first."""
        with self._lock:
            return None if self._last is None else self._last.stamp_ns

    def snapshot(self) -> Snapshot:
        """Return what is so now."""
        with self._lock:
            recent, mean = self._figures.recent, self._figures.mean
            return Snapshot(
                self._states,
                self._time_ns,
                self._q,
                self._hands,
                self._moving.rows,
                self._moving.wanted.copy(),
                Mode.LENT if self._lent else self._mode,
                self._loop,
                self._is_answered,
                recent[-1] if recent and self._is_answered else None,
                Mean(mean.ticks, mean.sums_cm),
            )

    def errors(self) -> list[TickError]:
        """Return the errors of the last ticks."""
        with self._lock:
            return list(self._figures.recent)

    def paths(self) -> tuple[Floats, Floats]:
        """Return the last positions asked for and reached [m], shapes (T, hands, 3)."""
        with self._lock:
            empty = np.empty((0, len(self.robot.hands), POSITION_SIZE))
            asked, reached = (np.array(path) if path else empty for path in (self._asked, self._reached))
            return asked, reached

    def _count(self, stamp_ns: int, passed_ns: int) -> None:
        """Count the error of the last tick, if a controller answers."""
        if self._last is None or not self._is_answered:
            self._rounds.break_off()
            return
        error = self._figures.add(stamp_ns, self._last.rows, self._q)
        self._rounds.add(self._followed, error, passed_ns * 1e-9)

    def _first(self, stamp_ns: int) -> Tick:
        """Return the first tick: where the hands are, so that nothing leaps."""
        moving = MovingTargets(self.robot, self._hands)
        moving.wanted, self._moving, self._gliding = self._moving.wanted, moving, True
        return self._tick(stamp_ns, 0.0, begins=True)

    def _tick(self, stamp_ns: int, time_s: float, *, begins: bool) -> Tick:
        self._advance(time_s)
        self._last = Tick(stamp_ns, self._moving.rows.copy(), begins)
        self._asked.append(self._moving.rows[:, :POSITION_SIZE])
        self._reached.append(self._hands[:, :POSITION_SIZE])
        return self._last

    def _advance(self, time_s: float) -> None:
        """Move the targets on: along the motion, or to where they are wanted."""
        loop, self._followed = self._loop, None
        if self._mode is not Mode.MOTION or loop is None:
            self._moving.advance(time_s)
            return
        if not self._gliding:
            self._gliding = loop.advance(time_s)
        self._moving.wanted = loop.rows
        if not self._gliding:
            self._moving.rows = loop.rows
            self._followed = None if loop.paused else loop
            return
        self._moving.advance(time_s)
        self._gliding = not self._moving.arrived

    def _rows(self, q: Floats) -> Floats:
        return to_rows(self.robot, self._kinematics.inputs(q))
