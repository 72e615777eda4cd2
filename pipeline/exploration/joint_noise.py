"""Joint noise: small random motions that are added to the commands of an exploration."""

import math
from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.seeding import uniforms

NOISE_TIME_S = 1.0
"""Time [s] after which the noise has forgotten where it was."""

_BLOCK = 4096  # steps drawn at a time


def joint_noise(robot: RobotConfig, *, seed: int, period_ns: int, share: float) -> Iterator[Floats]:
    """Yield an Ornstein-Uhlenbeck process, step by step, without end: offsets of the joints [rad or m], shape (n,).

    It begins at zero. No function of libm is in it: the steps are uniform draws of unit deviation, and a square root,
    which is exact.

    Parameters
    ----------
    robot : RobotConfig
        Its joints and their ranges.
    seed : int
        Names the draws.
    period_ns : int
        Period of the steps [ns].
    share : float
        Standard deviation of each joint's offset, as a part of its range, or of what it may move in a second if that is
        less.
    """
    joints = len(robot.joints)
    decay = period_ns * 1e-9 / NOISE_TIME_S
    span = np.minimum(robot.upper - robot.lower, robot.speed_limits)
    step = math.sqrt(3.0) * math.sqrt(decay * (2.0 - decay)) * share * span
    offset = 0.0 * step
    block = 0
    while True:
        drawn = 2.0 * uniforms(seed, "joint noise", block, count=_BLOCK * joints).reshape(_BLOCK, joints) - 1.0
        for unit in drawn:
            offset = offset - decay * offset + step * unit
            yield offset
        block += 1
