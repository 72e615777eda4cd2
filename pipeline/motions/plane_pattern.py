"""Patterns that hands draw in the robot's plane: angles that turn, and closed motions of them."""

import math
from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig

RADIUS_M = 0.10
PATTERN_PERIOD_S = 0.2  # the paper's 5 Hz


def turning_angles(turns: Sequence[int], *, samples: int, start: float) -> Floats:
    """Angles [rad] that make each number of `turns` in an equal part of the samples, shape (samples,)."""
    part = samples // len(turns)
    steps = np.repeat(2.0 * math.pi * np.array(turns, dtype=np.float64) / part, part)
    return start + np.concatenate([[0.0], np.cumsum(steps)[:-1]])


def plane_pattern(name: str, robot: RobotConfig, paths: Sequence[tuple[Floats, Floats]]) -> Motion:
    """Make a closed motion from each hand's (lateral, up) coordinates in radii, in the robot's plane."""
    # Sums and products written out, to the nanometre: the same targets, to the bit, on every machine.
    offsets = [RADIUS_M * (np.outer(aside, robot.lateral) + np.outer(up, robot.up)) for aside, up in paths]
    hands = [np.round(centre + offset, 9) for centre, offset in zip(robot.centres, offsets, strict=True)]
    times_s = np.round(PATTERN_PERIOD_S * np.arange(len(hands[0])), 9)
    return Motion(name, times_s, np.stack(hands, axis=1), closed=True)
