"""Errors of the hands as they move: of each target at the end of its hold, over a while, over rounds of a motion."""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.arrays import Floats
from pipeline.browser.session.motion_loop import MotionLoop
from pipeline.evaluation.errors import hand_errors, turn_errors
from pipeline.robot.coordinates import to_inputs
from pipeline.robot.kinematics import Kinematics

_CM_PER_M = 100.0
_REMEMBERED = 1000  # ticks: 20 s at 50 Hz
_CHANGE_S = 1.0  # so long after a change of the controller the robot is on its way from posture to posture
_SHORT_S = 0.05  # by so much a round may be short: an open motion is left before its last target is held


@dataclass(frozen=True, eq=False)
class TickError:
    """Distance of each hand from a target at the end of its hold.

    Attributes
    ----------
    time_ns : int
        Robot's time at the end of the hold [ns].
    distances_cm : ndarray
        By hand [cm], shape (hands,).
    turns_deg : dict of str to float
        Angles between orientation and target [degrees], by hand whose pose is controlled.
    """

    time_ns: int
    distances_cm: Floats
    turns_deg: dict[str, float]


@dataclass
class Mean:
    """Mean error of each hand over the ticks that were counted."""

    ticks: int = 0
    sums_cm: Floats = field(default_factory=lambda: np.zeros(0))

    def add(self, error: TickError) -> None:
        """Count the error of a tick."""
        self.sums_cm = error.distances_cm + (self.sums_cm if self.ticks else 0.0)
        self.ticks += 1

    @property
    def hands_cm(self) -> Floats:
        """Mean error of each hand [cm], shape (hands,); nothing before the first tick."""
        return self.sums_cm / max(1, self.ticks)


class Figures:
    """Errors of the last ticks, and their mean since they were last begun anew.

    The error of a target is as `evaluate` has it of pairs as commanded: the hands are computed of the joints that were
    measured when the next target came.

    Parameters
    ----------
    kinematics : Kinematics
        Of the robot.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self.recent: deque[TickError] = deque(maxlen=_REMEMBERED)
        self.mean = Mean()

    def begin(self) -> None:
        """Begin the mean anew."""
        self.mean = Mean()

    def add(self, time_ns: int, targets: Floats, q: Floats) -> TickError:
        """Take the joints (n,) at the end of the hold of targets by row, at a robot's time [ns]; return the error."""
        asked, posture = to_inputs(self._kinematics.robot, targets)[np.newaxis], q[np.newaxis]
        distances_cm = _CM_PER_M * hand_errors(self._kinematics, posture, asked)[0]
        turns = turn_errors(self._kinematics, posture, asked)
        error = TickError(time_ns, distances_cm, {hand: float(np.degrees(angles[0])) for hand, angles in turns.items()})
        self.recent.append(error)
        self.mean.add(error)
        return error


@dataclass
class Round:
    """Errors of the hands over a round of a motion, or as much of it as was driven.

    Attributes
    ----------
    duration_s : float
        Of the whole round [s].
    driven_s : float
        How much of it was driven [s].
    mean : Mean
        Mean error of each hand.
    largest_cm : ndarray
        Largest error of each hand [cm], shape (hands,).
    """

    duration_s: float
    driven_s: float = 0.0
    mean: Mean = field(default_factory=Mean)
    largest_cm: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def share(self) -> float:
        """How much of the round was driven, 0 to 1."""
        return 1.0 if self.is_whole else self.driven_s / self.duration_s

    @property
    def is_whole(self) -> bool:
        """Whether all of it was driven."""
        return self.driven_s >= self.duration_s - _SHORT_S

    def add(self, error: TickError, passed_s: float) -> None:
        """Count the error of a tick, of so much time [s]."""
        self.largest_cm = np.maximum(error.distances_cm, self.largest_cm if self.mean.ticks else 0.0)
        self.mean.add(error)
        self.driven_s += passed_s


class RoundFigures:
    """The last whole round of every controller through every motion, or the first one as far as it was driven.

    A round begins anywhere in the motion. The first second after another controller begins to lead counts for nothing,
    nor do ticks on the way to the motion or while it is paused, which break a round off.
    """

    def __init__(self) -> None:
        self._rounds: dict[tuple[str, int], dict[str, Round]] = {}
        self._controller = ""
        self._changing_s = 0.0
        self._loop: MotionLoop | None = None
        self._motion = ("", 0)
        self._under_way: Round | None = None

    def begin(self, controller: str) -> None:
        """Note that a controller leads from now on."""
        self._controller, self._changing_s, self._under_way = controller, _CHANGE_S, None

    def break_off(self) -> None:
        """Break off the round under way."""
        self._under_way = None

    def forget(self, controller: str) -> None:
        """Forget all rounds of a controller."""
        for rounds in self._rounds.values():
            rounds.pop(controller, None)

    def add(self, loop: MotionLoop | None, error: TickError, passed_s: float) -> None:
        """Take the error of a tick of a motion, after so much time [s]; the loop is None where none was followed."""
        self._changing_s = max(0.0, self._changing_s - passed_s)
        if loop is None or self._changing_s > 0.0:
            self._under_way = None
            return
        if loop is not self._loop:
            self._loop, self._motion, self._under_way = loop, _key(loop), None
        if self._under_way is None:
            self._under_way = Round(loop.duration_s)
        self._under_way.add(error, passed_s)
        rounds = self._rounds.setdefault(self._motion, {})
        if self._under_way.is_whole or not rounds.get(self._controller, self._under_way).is_whole:
            rounds[self._controller] = self._under_way
        if self._under_way.is_whole:
            self._under_way = None

    def of(self, loop: MotionLoop) -> dict[str, Round]:
        """Return the rounds through a motion by controller."""
        return {
            name: replace(found, mean=replace(found.mean)) for name, found in self._rounds.get(_key(loop), {}).items()
        }


def _key(loop: MotionLoop) -> tuple[str, int]:
    return loop.name, hash(loop.path.tobytes())
