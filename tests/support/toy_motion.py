"""A motion as somebody else brings it: both hands go up and down again."""

import numpy as np

from pipeline.motions.motion import Motion, NamedMotion
from pipeline.robot.config import RobotConfig


def lift(robot: RobotConfig) -> Motion:
    heights = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0]) / 64.0
    targets = robot.centres + heights[:, np.newaxis, np.newaxis] * np.array([0.0, 0.0, 1.0])
    return Motion("lift", 0.25 * np.arange(7.0), targets, closed=False)


MOTION = NamedMotion("lift", lift)
