"""Forward kinematics and Jacobians of the hands, by Pinocchio."""

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.hands import Quaternion
from pipeline.robot.pinocchio_model import build_model, joint_index, link_frame
from pipeline.urdf.description import canonical
from recorders.errors import JointError, RobotError

_ALIGNED = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Kinematics:
    """Hands of a robot as functions of its posture.

    Postures are arrays in the order of ``robot.joints``, whatever order the URDF has: joints are mapped by name.
    Positions are in the world frame [m]; hands are in the order of ``robot.hands``.

    Raises
    ------
    RobotError
        Pinocchio cannot build the URDF.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self.robot = robot
        try:
            self._model = build_model(canonical(robot.urdf_text))
        except RobotError as error:
            raise RobotError(f"robot '{robot.name}': {error}") from error
        self._data = self._model.createData()
        model_joints = [self._model.joints[joint_index(self._model, name)] for name in robot.joints]
        self._idx_q = np.array([joint.idx_q for joint in model_joints])
        self._idx_v = np.array([joint.idx_v for joint in model_joints])
        self._hands = [link_frame(self._model, hand.link) for hand in robot.hands]
        self._middles = [_rotation(hand.orientation) for hand in robot.hands]
        self._gaze = None if robot.gaze is None else link_frame(self._model, robot.gaze.frame)
        self._q: Floats = pinocchio.neutral(self._model)

    @property
    def lower(self) -> Floats:
        """Lower position limits [rad or m], shape (n,)."""
        return self.robot.lower

    @property
    def upper(self) -> Floats:
        """Upper position limits [rad or m], shape (n,)."""
        return self.robot.upper

    def hands(self, q: ArrayLike) -> Floats:
        """Positions of the hands [m] at posture `q` (n,), shape (hands, 3)."""
        pinocchio.forwardKinematics(self._model, self._data, self._posture(q))
        return self._hand_positions()

    def hands_along(self, q: ArrayLike) -> Floats:
        """Positions of the hands [m] at each posture of `q` (T, n), shape (T, hands, 3)."""
        postures = np.asarray(q, dtype=np.float64)
        return np.array([self.hands(posture) for posture in postures]).reshape(len(postures), len(self._hands), 3)

    def hands_and_jacobian(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Hand positions [m], shape (hands, 3), and their Jacobian, three rows a hand, shape (3 hands, n)."""
        pinocchio.computeJointJacobians(self._model, self._data, self._posture(q))
        positions = self._hand_positions()
        # Rows 0-2 of a frame's Jacobian are linear, in the axes of the world.
        spatial = [pinocchio.getFrameJacobian(self._model, self._data, frame, _ALIGNED) for frame in self._hands]
        jacobian: Floats = np.concatenate([rows[:3] for rows in spatial])[:, self._idx_v]
        return positions, jacobian

    def inputs(self, q: ArrayLike) -> Floats:
        """Positions [m], and turns [rad] where the pose is controlled, of all hands at posture `q` (n,): (inputs,)."""
        pinocchio.forwardKinematics(self._model, self._data, self._posture(q))
        return self._inputs_here()

    def inputs_along(self, q: ArrayLike) -> Floats:
        """Return `inputs` at each posture of `q` (T, n), shape (T, inputs)."""
        postures = np.asarray(q, dtype=np.float64)
        return np.array([self.inputs(posture) for posture in postures]).reshape(len(postures), -1)

    def inputs_and_jacobian(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Return `inputs` at posture `q` (n,), shape (inputs,), and their Jacobian, shape (inputs, n).

        With R the rotation from the orientation in the middle, and r its vector, w the hand's angular velocity in the
        axes of the world: dr/dt = J(r) w, J the transpose of Pinocchio's Jacobian of the logarithm at R.
        """
        pinocchio.computeJointJacobians(self._model, self._data, self._posture(q))
        inputs, rows = self._inputs_here(), list[Floats]()
        for frame, middle in zip(self._hands, self._middles, strict=True):
            spatial = pinocchio.getFrameJacobian(self._model, self._data, frame, _ALIGNED)
            rows.append(spatial[:3])
            if middle is not None:
                turned = self._data.oMf[frame].rotation @ middle.T
                rows.append(pinocchio.Jlog3(turned).T @ spatial[3:])
        jacobian: Floats = np.concatenate(rows)[:, self._idx_v]
        return inputs, jacobian

    def in_gaze_frame(self, q: ArrayLike, point: ArrayLike) -> Floats:
        """`point` [m] (3,) of the world as the gaze frame sees it at posture `q` (n,): x ahead, z up, shape (3,).

        Raises
        ------
        RobotError
            The robot has no gaze.
        """
        if self._gaze is None:
            raise RobotError(f"robot '{self.robot.name}': expected a [gaze] in its config, found none")
        pinocchio.forwardKinematics(self._model, self._data, self._posture(q))
        pose = pinocchio.updateFramePlacement(self._model, self._data, self._gaze)
        seen: Floats = pose.actInv(np.asarray(point, dtype=np.float64))
        return seen

    def inertia_diagonal(self, q: ArrayLike) -> Floats:
        """Diagonal of the joint-space mass matrix [kg m^2 or kg] at posture `q` (n,), shape (n,)."""
        mass_matrix = pinocchio.crba(self._model, self._data, self._posture(q))
        diagonal: Floats = np.diagonal(mass_matrix)[self._idx_v].copy()
        return diagonal

    def _posture(self, q: ArrayLike) -> Floats:
        posture = np.asarray(q, dtype=np.float64)
        if posture.shape != self._idx_q.shape:
            raise JointError(f"expected a posture of shape {self._idx_q.shape}, found {posture.shape}")
        self._q[self._idx_q] = posture
        return self._q

    def _inputs_here(self) -> Floats:
        parts = list[Floats]()
        for frame, middle in zip(self._hands, self._middles, strict=True):
            placement = pinocchio.updateFramePlacement(self._model, self._data, frame)
            parts.append(placement.translation)
            if middle is not None:
                parts.append(pinocchio.log3(placement.rotation @ middle.T))
        return np.concatenate(parts)

    def _hand_positions(self) -> Floats:
        placements = (pinocchio.updateFramePlacement(self._model, self._data, frame) for frame in self._hands)
        return np.array([placement.translation for placement in placements])


def _rotation(orientation: Quaternion | None) -> Floats | None:
    """Return the rotation matrix of a quaternion x, y, z, w, if there is one."""
    if orientation is None:
        return None
    rotation: Floats = pinocchio.Quaternion(np.array(orientation)).toRotationMatrix()
    return rotation
