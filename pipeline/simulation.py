"""The simulated robot: Drake's multibody dynamics under joint servos, stepped in exact nanoseconds."""

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains, RigidBody
from pydrake.systems.analysis import Simulator

from pipeline.backend import LinkPose
from pipeline.kinematics import Kinematics
from pipeline.robot import RobotConfig
from pipeline.urdf import canonical_urdf, joint_links, one_line
from recorders.errors import ConfigError, JointError, RobotError

Floats = NDArray[np.float64]

_XYZW = [1, 2, 3, 0]  # Drake's quaternions begin with w, those of ROS end with it


@dataclass(frozen=True)
class SimulationConfig:
    """How the robot is simulated.

    Attributes
    ----------
    step_ns : step of the dynamics [ns]
    control_ns : period at which lag filter and gravity feed-forward are renewed [ns], a multiple of `step_ns`
    lag_s : time constant with which the servos' set point follows the command [s]
    bandwidth : natural frequency of every servo [rad/s]; critically damped
    """

    step_ns: int = 1_000_000
    control_ns: int = 5_000_000
    lag_s: float = 0.03
    bandwidth: float = 30.0

    def __post_init__(self) -> None:
        if self.step_ns <= 0 or self.control_ns <= 0 or self.control_ns % self.step_ns:
            raise ConfigError(
                "simulation: expected step_ns above 0 and control_ns a multiple of it, "
                f"found {self.step_ns} and {self.control_ns}"
            )
        if not 0.0 <= self.lag_s < math.inf:
            raise ConfigError(f"simulation lag_s: expected at least 0, found {self.lag_s}")
        if not 0.0 < self.bandwidth < math.inf:
            raise ConfigError(f"simulation bandwidth: expected above 0, found {self.bandwidth}")


class Simulation:
    """A robot in Drake: discrete dynamics (SAP), a PD servo with gravity feed-forward on every joint, no contact.

    A servo's stiffness is M_ii * bandwidth^2, with M_ii the joint's inertia at the comfort posture, so that all joints
    answer alike. Implements `pipeline.backend.RobotBackend`.

    Raises
    ------
    RobotError
        Drake cannot build the URDF, or finds no motor for a joint.
    """

    def __init__(self, robot: RobotConfig, config: SimulationConfig = SimulationConfig()) -> None:
        logging.getLogger("drake").setLevel(logging.ERROR)  # its remarks on the URDF are not for our users
        self._robot = robot
        self._config = config
        self._plant: Any = self._build_plant()  # Any: the types that Drake declares for arrays are not numpy's
        self._joints = [self._plant.GetJointByName(name) for name in robot.joints]
        self._positions = np.array([joint.position_start() for joint in self._joints])
        self._velocities = np.array([joint.velocity_start() for joint in self._joints])
        self._inputs = np.array([self._plant.GetJointActuatorByName(name).input_start() for name in self._motors])
        self._hands = [self._plant.GetBodyByName(name) for name in (robot.left_hand, robot.right_hand)]
        self._links = list(joint_links(robot.urdf_text).values())  # parent and child
        self._frames = [tuple(self._plant.GetBodyByName(link).body_frame() for link in pair) for pair in self._links]
        self._simulator = Simulator(self._plant)
        self._context = self._simulator.get_mutable_context()
        self.reset(robot.comfort)

    def _build_plant(self) -> MultibodyPlant:
        plant = MultibodyPlant(time_step=self._config.step_ns * 1e-9)
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        plant.SetUseSampledOutputPorts(False)  # nothing reads accelerations or reaction forces
        try:
            (self._model,) = Parser(plant).AddModelsFromString(canonical_urdf(self._robot.urdf_text), "urdf")
        except (RuntimeError, ValueError) as error:
            raise RobotError(f"robot '{self._robot.name}': the URDF does not build: {one_line(str(error))}") from error
        motors = {
            actuator.joint().name(): actuator
            for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        }
        if unmoved := [name for name in self._robot.joints if name not in motors]:
            raise RobotError(
                f"robot '{self._robot.name}': Drake makes no motor for {', '.join(unmoved)}: expected a transmission "
                "of type transmission_interface/SimpleTransmission and an effort limit above 0"
            )
        self._motors = [motors[name].name() for name in self._robot.joints]
        inertias = Kinematics(self._robot).inertia_diagonal(self._robot.comfort)
        for name, inertia in zip(self._robot.joints, inertias, strict=True):
            if not inertia > 0.0:  # of a gain below 0 Drake ends the process
                raise RobotError(
                    f"robot '{self._robot.name}': joint {name} moves an inertia of {inertia:g}, expected one above 0: "
                    "give the links beyond it masses and moments"
                )
            stiffness, damping = inertia * self._config.bandwidth**2, 2.0 * inertia * self._config.bandwidth
            motors[name].set_controller_gains(PdControllerGains(p=stiffness, d=damping))
        plant.Finalize()
        return plant

    @property
    def robot(self) -> RobotConfig:
        """The robot being simulated."""
        return self._robot

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]."""
        return self._time_ns

    @property
    def positions(self) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        positions: Floats = self._plant.GetPositions(self._context)[self._positions]
        return positions

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        velocities: Floats = self._plant.GetVelocities(self._context)[self._velocities]
        return velocities

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        """Stand still at posture `q` (n,), at a time [ns].

        Raises
        ------
        JointError
            `q` has the wrong shape or is not finite.
        """
        posture = self._checked(q)
        self._time_ns = time_ns
        self._set_point = posture
        self._context.SetTime(time_ns / 1_000_000_000)
        positions = np.zeros(self._plant.num_positions())
        positions[self._positions] = posture
        self._plant.SetPositions(self._context, positions)
        self._plant.SetVelocities(self._context, np.zeros(self._plant.num_velocities()))
        self._drive(posture)
        self._simulator.Initialize()

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        """Command posture `q_command` (n,) and simulate `duration_ns`, a multiple of the control period.

        Raises
        ------
        JointError
            `q_command` has the wrong shape or is not finite.
        ConfigError
            `duration_ns` is not a multiple of the control period.
        """
        command = self._checked(q_command)
        if duration_ns < 0 or duration_ns % self._config.control_ns:
            period_ns = self._config.control_ns
            raise ConfigError(f"simulation: expected a duration in multiples of {period_ns} ns, found {duration_ns} ns")
        for _ in range(duration_ns // self._config.control_ns):
            self._drive(command)
            self._time_ns += self._config.control_ns
            self._simulator.AdvanceTo(self._time_ns / 1_000_000_000)

    def hands(self) -> Floats:
        """Positions of both hands [m], left then right, world frame, shape (2, 3)."""
        return np.array([self._pose(body).translation() for body in self._hands])

    def link_poses(self) -> list[LinkPose]:
        """Pose of every link in its parent link, in the canonical order of the joints."""
        poses_PC = [self._plant.CalcRelativeTransform(self._context, *frames) for frames in self._frames]
        wxyz = np.array([X_PC.rotation().ToQuaternion().wxyz() for X_PC in poses_PC])
        return [
            LinkPose(parent, child, X_PC.translation(), rotation)
            for (parent, child), X_PC, rotation in zip(self._links, poses_PC, wxyz[:, _XYZW], strict=True)
        ]

    def _pose(self, body: RigidBody) -> RigidTransform:
        pose: RigidTransform = self._plant.EvalBodyPoseInWorld(self._context, body)
        return pose

    def _checked(self, q: ArrayLike) -> Floats:
        posture = np.array(q, dtype=np.float64)
        if posture.shape != (len(self._joints),):
            raise JointError(f"expected a posture of shape ({len(self._joints)},), found {posture.shape}")
        if not np.isfinite(posture).all():
            name = self._robot.joints[int(np.flatnonzero(~np.isfinite(posture))[0])]
            raise JointError(f"expected a finite position for joint {name}, found {posture}")
        return posture

    def _drive(self, command: Floats) -> None:
        """Renew set point and gravity feed-forward for the next control period."""
        period_s = self._config.control_ns * 1e-9
        step = (command - self._set_point) * (period_s / (self._config.lag_s + period_s))
        desired = np.empty(2 * len(self._joints))  # [q; v] in actuator order
        desired[self._inputs] = self._set_point + step / 2  # halfway, as it stays for the whole period
        desired[self._inputs + len(self._joints)] = step / period_s
        self._set_point = self._set_point + step
        self._plant.get_desired_state_input_port(self._model).FixValue(self._context, desired)
        feed_forward = np.empty(len(self._joints))
        feed_forward[self._inputs] = -self._plant.CalcGravityGeneralizedForces(self._context)[self._velocities]
        self._plant.get_actuation_input_port().FixValue(self._context, feed_forward)
