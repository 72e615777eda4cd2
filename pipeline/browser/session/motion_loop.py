"""A motion that is gone through in the robot's time, again and again, and can be moved to any place of it."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.motion import Motion
from pipeline.robot.coordinates import POSITION_SIZE


class MotionLoop:
    """Targets of a motion by time.

    Parameters
    ----------
    motion : Motion
        What is gone through; between samples, targets are interpolated.

    Attributes
    ----------
    name : str
        Of the motion.
    duration_s : float
        From the first sample to the last, or to the first again where the motion is closed [s].
    at_s : float
        How far it has come [s].
    paused : bool
        Whether time stands still.
    """

    def __init__(self, motion: Motion) -> None:
        times_s, targets = motion.times_s - motion.times_s[0], motion.targets
        if motion.closed:  # the first sample follows the last, after as long as it took from the one before
            times_s = np.append(times_s, 2.0 * times_s[-1] - times_s[-2])
            targets = np.concatenate([targets, targets[:1]])
        self._times_s, self._targets, self._closed = times_s, targets, motion.closed
        self.name = motion.name
        self.duration_s = float(times_s[-1])
        self.at_s = 0.0
        self.paused = False

    @property
    def path(self) -> Floats:
        """Positions of all samples [m], shape (T, hands, 3)."""
        return self._targets[..., :POSITION_SIZE]

    def seek(self, at_s: float) -> None:
        """Go to a place of the motion [s]."""
        self.at_s = min(max(0.0, at_s), self.duration_s)

    def advance(self, time_s: float) -> bool:
        """Let time pass [s]; True if the motion began anew in a place away from where it ended."""
        if self.paused:
            return False
        self.at_s += time_s
        if self.at_s < self.duration_s:
            return False
        self.at_s = self.at_s % self.duration_s if self._closed else 0.0
        return not self._closed

    @property
    def rows(self) -> Floats:
        """The targets where it has come to, by row, shape (hands, 3 or 7)."""
        after = int(np.clip(np.searchsorted(self._times_s, self.at_s, side="right"), 1, len(self._times_s) - 1))
        begin_s, end_s = self._times_s[after - 1 : after + 1]
        share = (self.at_s - begin_s) / (end_s - begin_s)
        before, following = self._targets[after - 1], self._targets[after].copy()
        following[:, POSITION_SIZE:] *= _nearer_signs(before, following)
        rows: Floats = before + share * (following - before)
        lengths = np.linalg.norm(rows[:, POSITION_SIZE:], axis=1, keepdims=True)
        rows[:, POSITION_SIZE:] /= np.where(lengths > 0.0, lengths, 1.0)
        return rows


def _nearer_signs(before: Floats, following: Floats) -> Floats:
    """Return the signs, shape (hands, 1), with which quaternions are the nearer to those before."""
    cosines = (before[:, POSITION_SIZE:] * following[:, POSITION_SIZE:]).sum(axis=1, keepdims=True)
    return np.where(cosines < 0.0, -1.0, 1.0)
