"""Joints as measured, and the hands that the robot's kinematics computes of them: where no hands are measured."""

from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, row_size, to_inputs
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.rotations import quaternions_of_matrices
from pipeline.samples.pairing import PairingRule
from pipeline.samples.rules.reached import ReachedPairs
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.ticks.joiner import Tick


class ComputedPairs(ReachedPairs):
    """Makes a step of every tick: x(k) is where the robot's kinematics has the hands at q(k), and d(k) = (x(k); q(k)).

    All else is as with hands as measured.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    """

    def __init__(self, robot: RobotConfig) -> None:
        super().__init__(robot)
        self._kinematics, self._robot = HandKinematics(robot), robot
        self._of_positions = row_size(robot) == POSITION_SIZE

    def fill_hands(self, tick: Tick, joints: Floats, u: Floats) -> None:
        """Write the hands that are computed of the posture into the inputs."""
        u[:] = self._kinematics.positions(joints).ravel() if self._of_positions else self._inputs(joints)

    def _inputs(self, joints: Floats) -> Floats:
        """Return the inputs (inputs,) at a posture (n,) [rad or m]."""
        positions, rotations = self._kinematics.poses(joints)
        rows = np.concatenate([positions, quaternions_of_matrices(rotations)], axis=-1)
        return to_inputs(self._robot, rows)


def _joints_alone(_hands: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a tick of joints alone, whatever hands there are."""
    return (SAMPLE_JOINTS,)


RULE = PairingRule("computed", _joints_alone, ComputedPairs)
