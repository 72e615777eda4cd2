"""Errors of the hands as they move: of each target at the end of its hold, and their mean over a while."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors, turn_errors
from pipeline.robot.coordinates import to_inputs
from pipeline.robot.kinematics import Kinematics

_CM_PER_M = 100.0
_REMEMBERED = 1000  # ticks: 20 s at 50 Hz


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

    def add(self, time_ns: int, targets: Floats, q: Floats) -> None:
        """Take the joints (n,) at the end of the hold of targets by row, at a time of the robot [ns]."""
        asked, posture = to_inputs(self._kinematics.robot, targets)[np.newaxis], q[np.newaxis]
        distances_cm = _CM_PER_M * hand_errors(self._kinematics, posture, asked)[0]
        turns = turn_errors(self._kinematics, posture, asked)
        error = TickError(time_ns, distances_cm, {hand: float(np.degrees(angles[0])) for hand, angles in turns.items()})
        self.recent.append(error)
        self.mean.add(error)
