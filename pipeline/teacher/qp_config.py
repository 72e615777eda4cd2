"""Settings of the teacher on Drake's differential inverse kinematics; Drake itself is not needed for them."""

import math
from dataclasses import dataclass

from recorders.errors import ConfigError

SLACK_M = 0.002
"""Distances may be this much below the clearance [m] before a step is shortened."""

SOLVER_SPREAD = 5e-4
"""Explorations of this teacher on two machines may be so far apart [rad or m]: OSQP iterates, and ends elsewhere."""


@dataclass(frozen=True)
class QpTeacherConfig:
    """Settings of the teacher on Drake's differential inverse kinematics.

    Attributes
    ----------
    period_ns : int
        Control period [ns].
    gain : float
        Approach of the hands to their targets [1/s].
    comfort_gain : float
        Approach to the comfort posture where it moves no hand [1/s].
    margin : float
        Smallest distance kept from a limit, as a part of the joint's range.
    speed_share : float
        Largest speed of a joint, as a part of the limit in the URDF.
    clearance_m : float
        Distance kept between hands or forearms and other parts of the robot, to `SLACK_M` [m]; 0 for none.
    """

    period_ns: int = 5_000_000
    gain: float = 6.0
    comfort_gain: float = 5.0
    margin: float = 0.02
    speed_share: float = 0.7
    clearance_m: float = 0.045

    def __post_init__(self) -> None:
        for name in ("period_ns", "gain", "speed_share"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"qp teacher {name}: expected above 0, found {getattr(self, name)}")
        if not 0 <= self.comfort_gain < math.inf:
            raise ConfigError(f"qp teacher comfort_gain: expected at least 0, found {self.comfort_gain}")
        if self.clearance_m != 0 and not SLACK_M < self.clearance_m < math.inf:
            raise ConfigError(f"qp teacher clearance_m: expected 0, or above {SLACK_M}, found {self.clearance_m}")
        if not 0 < self.margin < 0.5:
            raise ConfigError(f"qp teacher margin: expected between 0 and 0.5, found {self.margin}")
