"""Extent of the joints in what was learned: a robot that hardly moves teaches little, and no controller shows it."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from recorders.errors import LearningError
from recorders.text.wording import names_text

FEW_SAMPLES = 50
"""Fewer samples than this are few: five seconds at 10 Hz."""

_HARDLY = 0.01  # of its range: a joint that moves by less has hardly moved
_AT_REST = 0.001  # of their ranges: joints that all move by less rest, and what is measured is noise


class JointExtent:
    """Collects the lowest and the highest position of every joint.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints they are.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._lowest = np.full(len(robot.joints), np.inf)
        self._highest = np.full(len(robot.joints), -np.inf)

    def take(self, joints: Floats) -> None:
        """Take postures [rad or m], shape (T, n), T >= 1."""
        self._lowest = np.minimum(self._lowest, joints.min(axis=0))
        self._highest = np.maximum(self._highest, joints.max(axis=0))

    def check_moved(self, samples: int) -> None:
        """Check that any joint moved.

        Parameters
        ----------
        samples : int
            How many different ones were learned from: a single one cannot show it.

        Raises
        ------
        LearningError
            If none did.
        """
        if samples > 1 and not (self._shares() > _AT_REST).any():
            raise LearningError(
                f"nothing was learned: expected joints that move, found all within {_AT_REST:.1%} of their range; "
                "record the robot while it moves"
            )

    def notes(self, samples: int) -> list[str]:
        """Return a line each on few samples, on joints that hardly moved, and on joints beyond their limits.

        Parameters
        ----------
        samples : int
            How many different ones were learned from.
        """
        lines = []
        if samples < FEW_SAMPLES:
            lines.append(f"{samples} samples are few: what the controller has not seen it does not know")
        if samples > 1 and (still := self._named(self._shares() <= _HARDLY)):
            lines.append(f"moved by at most {_HARDLY:.0%} of their range, which teaches next to nothing: {still}")
        allowed = _HARDLY * (self._robot.upper - self._robot.lower)
        beyond = (self._lowest < self._robot.lower - allowed) | (self._highest > self._robot.upper + allowed)
        if outside := self._named(beyond):
            lines.append(f"beyond their limits, where commands stop, so that hands miss: {outside}")
        return lines

    def _shares(self) -> Floats:
        """Return how far each joint moved, as a share of its range."""
        return np.asarray((self._highest - self._lowest) / (self._robot.upper - self._robot.lower))

    def _named(self, which: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> str:
        """Return some joints with where they were, and their limits."""
        robot = self._robot
        return names_text(
            f"{robot.joints[index]} ({self._lowest[index]:.3g} to {self._highest[index]:.3g}, limits "
            f"{robot.lower[index]:.3g} and {robot.upper[index]:.3g})"
            for index in np.flatnonzero(which)
        )
