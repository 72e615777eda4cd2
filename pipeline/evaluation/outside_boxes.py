"""Targets outside the boxes of a robot's hands, in which it explores: answers there are guesses."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE
from recorders.text.wording import hand_text, names_text

_LEAST_M = 0.001


def outside_boxes_text(robot: RobotConfig, motion: str, targets: Floats) -> str | None:
    """Return one line for a motion that leaves the boxes of a robot's hands; None if it stays within them.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    motion : str
        Name of the motion.
    targets : array, shape (T, hands, 3 or more)
        Targets of the hands, positions first [m].
    """
    beyond_m = (np.abs(targets[:, :, :POSITION_SIZE] - robot.centres) - robot.boxes).max(axis=(0, 2))  # (hands,)
    found = [
        f"{100 * excess_m:.1f} cm outside the box of {hand_text(hand)}"
        for hand, excess_m in zip(robot.hand_names, beyond_m.tolist(), strict=True)
        if excess_m > _LEAST_M
    ]
    if not found:
        return None
    return f"{motion}: has targets up to {names_text(found)}; what was explored in the boxes alone is a guess there"
