"""How near a motion comes to the limits of the robot: of its joints' positions and speeds, and of its own body."""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.collision.self_distance import CLEARANCE_M, NOTHING_NEAR, SelfDistance
from pipeline.robot.config import RobotConfig
from recorders.errors import MotionError


class LimitsReached(NamedTuple):
    """The worst of a motion.

    Attributes
    ----------
    limit_margin : float
        Smallest distance of a joint from a limit, as a part of its range.
    limit_joint : str
        The joint that came so near.
    joint_speed : float
        Largest speed of a joint, as a part of the URDF's limit.
    speed_joint : str
        The joint that was so fast.
    self_distance_cm : float or None
        Smallest distance between hands or forearms and other parts of the robot [cm], to the micrometre, as finely as
        distances are computed; None if it has no parts to check.
    nearest_links : (str, str) or None
        The links of these parts.
    """

    limit_margin: float
    limit_joint: str
    joint_speed: float
    speed_joint: str
    self_distance_cm: float | None
    nearest_links: tuple[str, str] | None


class MotionLimits:
    """Watches a robot's postures for the worst of them.

    Parameters
    ----------
    robot : RobotConfig
        The robot; postures have the order of its joints.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._span = robot.upper - robot.lower
        self._speeds = robot.speed_limits
        self._distances = SelfDistance(robot)
        self._margins = np.full(len(robot.joints), np.inf)
        self._fastest = np.zeros(len(robot.joints))
        self._nearest = NOTHING_NEAR

    def update(self, positions: Floats, velocities: Floats) -> None:
        """Take in a posture (n,) [rad or m] and its velocities (n,)."""
        margins = np.minimum(positions - self._robot.lower, self._robot.upper - positions) / self._span
        self._margins = np.minimum(self._margins, margins)
        self._fastest = np.maximum(self._fastest, np.abs(velocities) / self._speeds)
        self._nearest = self._distances.nearest(positions, below=self._nearest)

    def check_clearance(self) -> None:
        """Raise MotionError if the hands came nearer to the robot's own parts than `CLEARANCE_M`."""
        if self._nearest.distance_m < CLEARANCE_M:
            found, first, second = self._nearest
            raise MotionError(
                f"robot '{self._robot.name}': expected {100 * CLEARANCE_M:g} cm between hands and body, found "
                f"{100 * found:.1f} cm between {first} and {second}: make the hands' boxes smaller"
            )

    @property
    def reached(self) -> LimitsReached:
        """The worst so far."""
        tight, fast = int(self._margins.argmin()), int(self._fastest.argmax())
        checked = self._distances.pairs > 0
        return LimitsReached(
            limit_margin=float(self._margins[tight]),
            limit_joint=self._robot.joints[tight],
            joint_speed=float(self._fastest[fast]),
            speed_joint=self._robot.joints[fast],
            self_distance_cm=round(100.0 * self._nearest.distance_m, 4) if checked else None,
            nearest_links=(self._nearest.first, self._nearest.second) if checked else None,
        )
