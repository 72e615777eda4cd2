"""Hands that each joint moves, in whatever posture: one may turn about an axis through a hand, and moves it nowhere."""

import numpy as np
import numpy.typing as npt

from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import hand_slices
from pipeline.robot.kinematics import Kinematics
from recorders.text.wording import names_text

_POSTURES = 8
_LEAST = 1e-4  # of a hand's motion for a joint's [m or rad, for rad or m]: less is rounding in a URDF


def moved_hands(robot: RobotConfig) -> npt.NDArray[np.bool_]:
    """Return whether each joint moves each hand, or turns it where the pose is controlled, shape (n, hands)."""
    kinematics = Kinematics(robot)
    shares = np.random.default_rng(0).uniform(0.1, 0.9, (_POSTURES, len(robot.joints)))
    postures = robot.lower + shares * (robot.upper - robot.lower)
    largest = np.max([np.abs(kinematics.inputs_and_jacobian(posture)[1]) for posture in postures], axis=0)
    return np.stack([largest[where].max(axis=0) > _LEAST for where in hand_slices(robot)], axis=1)


def idle_joints_text(robot: RobotConfig) -> str | None:
    """Return one line for joints that move no hand; None if there are none."""
    idle = [joint for joint, moved in zip(robot.joints, moved_hands(robot), strict=True) if not moved.any()]
    if not idle:
        return None
    return (
        f"{names_text(idle)}: moves no hand, as its axis goes through it; it may be made rigid (--fix JOINT), or the "
        "hand be a link beside the axis"
    )
