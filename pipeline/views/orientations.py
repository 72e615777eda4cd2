"""Orientations of the hands whose pose is controlled, asked for and reached, as viewers show them."""

from collections.abc import Mapping
from typing import TypeAlias

from pipeline.arrays import Floats
from pipeline.robot.coordinates import POSITION_SIZE, to_rows
from pipeline.robot.kinematics import Kinematics

Orientations: TypeAlias = Mapping[str, tuple[Floats, Floats]]


def orientations(kinematics: Kinematics, targets: Floats, joints: Floats) -> Orientations:
    """Return quaternions x, y, z, w of the targets and of the hands as reached, shape (T, 4) each, by hand.

    Parameters
    ----------
    kinematics : Kinematics
        Of the robot.
    targets : ndarray, shape (T, inputs)
        What is asked for.
    joints : ndarray, shape (T, n)
        Postures [rad or m].
    """
    return orientations_of_rows(kinematics, to_rows(kinematics.robot, targets), joints)


def orientations_of_rows(
    kinematics: Kinematics, targets: Floats, joints: Floats
) -> Mapping[str, tuple[Floats, Floats]]:
    """Return the same for targets by row, shape (T, hands, row size)."""
    robot = kinematics.robot
    posed = [place for place, hand in enumerate(robot.hands) if hand.orientation is not None]
    if not posed:
        return {}
    reached = to_rows(robot, kinematics.inputs_along(joints))
    return {
        robot.hand_names[place]: (targets[:, place, POSITION_SIZE:], reached[:, place, POSITION_SIZE:])
        for place in posed
    }
