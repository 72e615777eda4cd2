"""A robot node without Drake, for simulated hours: python tests/soak/kinematic_robot.py ENDPOINT RATE_HZ.

It is the program's own robot node, in lockstep, and steps as fast as it is commanded; only what is behind it is not
Drake but joints that go a part of the way to their command in each period. Its links are the hands alone.
"""

import sys

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPose
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_node.follower import FollowerConfig
from pipeline.robot_node.node import RobotNode
from pipeline.terminal.signals import end_by_exceptions
from recorders.nodes.node import running_node
from recorders.wire.session import SessionConfig, open_session

_SHARE = 0.3  # of the way to its command that a joint goes in a period
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


class KinematicRobot:
    """Joints without mass. Implements `pipeline.robot.backend.LinkPoseSource`."""

    def __init__(self, robot: RobotConfig) -> None:
        self._kinematics = Kinematics(robot)
        self.reset(robot.comfort)

    @property
    def robot(self) -> RobotConfig:
        return self._kinematics.robot

    @property
    def time_ns(self) -> int:
        return self._time_ns

    @property
    def positions(self) -> Floats:
        return self._positions

    @property
    def velocities(self) -> Floats:
        return self._velocities

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        self._positions = np.array(q, dtype=np.float64)
        self._velocities = np.zeros_like(self._positions)
        self._time_ns = time_ns

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        way = _SHARE * (np.asarray(q_command, dtype=np.float64) - self._positions)
        self._positions = self._positions + way
        self._velocities = way * (1e9 / duration_ns)
        self._time_ns += duration_ns

    def hands(self) -> Floats:
        return self._kinematics.hands(self._positions)

    def link_poses(self) -> list[LinkPose]:
        hands = zip(self.robot.hands, self.hands(), strict=True)
        return [LinkPose("world", hand.link, position, _UPRIGHT) for hand, position in hands]


def main(endpoint: str, rate_hz: float) -> None:
    config = FollowerConfig(rate_hz=rate_hz, period_ns=round(1e9 / rate_hz))
    session = SessionConfig(connect=(endpoint,))
    with (
        open_session(session) as opened,
        RobotNode(KinematicRobot(load_robot("asimo")), opened, config=config) as node,
        running_node(opened, node.source(), config=session, namespace="reenact"),
    ):
        node.run()


if __name__ == "__main__":
    end_by_exceptions()
    main(sys.argv[1], float(sys.argv[2]))
