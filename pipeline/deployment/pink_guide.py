"""pink as a guide, where it is installed: an inverse kinematics that knows the robot, to compare with."""

from importlib import import_module
from typing import Any

import numpy as np
import pinocchio

from pipeline.arrays import Floats
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE
from pipeline.robot.pinocchio_model import build_model, joint_index
from pipeline.urdf.description import canonical
from pipeline.urdf.model_names import link_name

STEP_SHARE = 0.5
"""Part of the way to a target that is asked of each step of 5 ms of those that know the robot."""

_POSTURE_COST = 1e-3  # the hands' tasks cost 1


class PinkGuide:
    """A frame task for each hand, half of whose way is asked of each step, and a weak task for the posture.

    Parameters
    ----------
    robot : RobotConfig
        The robot. The package pink, and its solver daqp, must be installed.
    """

    period_ns = 5_000_000

    def __init__(self, robot: RobotConfig) -> None:
        self._pink: Any = import_module("pink")
        self._robot, self._model = robot, build_model(canonical(robot.urdf_text))
        self._idx_q = np.array([self._model.joints[joint_index(self._model, name)].idx_q for name in robot.joints])
        tasks = self._pink.tasks
        self._hands = [
            tasks.FrameTask(
                link_name(hand.link),
                position_cost=1.0,
                orientation_cost=0.0 if hand.orientation is None else 1.0,
                gain=STEP_SHARE,
            )
            for hand in robot.hands
        ]
        self._posture = tasks.PostureTask(cost=_POSTURE_COST)
        self._posture.set_target(self._whole(robot.comfort))

    def observe(self, robot: RobotBackend) -> None:
        """Take no notice: it follows its own commands."""

    def step(self, q: Floats, targets: Floats) -> Floats:
        """Return the posture to command one period after commanding `q` (n,), for `targets` by row."""
        configuration = self._pink.Configuration(self._model, self._model.createData(), self._whole(q))
        for task, target in zip(self._hands, targets, strict=True):
            turned = pinocchio.Quaternion(target[POSITION_SIZE:]) if len(target) > POSITION_SIZE else None
            rotation = np.eye(3) if turned is None else turned.normalized().toRotationMatrix()
            task.set_target(pinocchio.SE3(rotation, target[:POSITION_SIZE]))
        period_s = self.period_ns / 1_000_000_000
        velocity = self._pink.solve_ik(configuration, [*self._hands, self._posture], period_s, solver="daqp")
        configuration.integrate_inplace(velocity, period_s)
        within: Floats = np.clip(configuration.q[self._idx_q], self._robot.lower, self._robot.upper)
        return within

    def _whole(self, q: Floats) -> Floats:
        whole: Floats = pinocchio.neutral(self._model)
        whole[self._idx_q] = q
        return whole
