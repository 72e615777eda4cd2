"""Places of a robot's joints, and what its motors exert to hold a posture."""

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.pinocchio_model import build_model, joint_index
from pipeline.urdf.description import canonical
from pipeline.urdf.joints import effort_limits


class Statics:
    """A robot that holds still; postures are arrays in the order of its joints.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    """

    def __init__(self, robot: RobotConfig) -> None:
        urdf = canonical(robot.urdf_text)
        self._model = build_model(urdf)
        self._data = self._model.createData()
        self._indices = [joint_index(self._model, name) for name in robot.joints]
        self._idx_q = np.array([self._model.joints[index].idx_q for index in self._indices])
        self._idx_v = np.array([self._model.joints[index].idx_v for index in self._indices])
        self._q: Floats = pinocchio.neutral(self._model)
        self.efforts = effort_limits(urdf, robot.joints)

    def heights(self, q: ArrayLike) -> Floats:
        """Heights of the joints' origins [m] at posture `q` (n,), world frame, shape (n,)."""
        return self.origins(q)[:, 2]

    def origins(self, q: ArrayLike) -> Floats:
        """Origins of the joints [m] at posture `q` (n,), world frame, shape (n, 3)."""
        self._q[self._idx_q] = q
        pinocchio.forwardKinematics(self._model, self._data, self._q)
        return np.array([self._data.oMi[index].translation for index in self._indices])

    def loads(self, q: ArrayLike) -> Floats:
        """Efforts that hold posture `q` (n,) against gravity, in parts of the motors' limits, at least 0, (n,)."""
        self._q[self._idx_q] = q
        gravity = pinocchio.computeGeneralizedGravity(self._model, self._data, self._q)
        loads: Floats = np.abs(gravity[self._idx_v]) / self.efforts
        return loads
