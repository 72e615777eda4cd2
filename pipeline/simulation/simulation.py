"""The simulated robot: Drake's multibody dynamics under joint servos, stepped in exact nanoseconds."""

import logging
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RigidBody

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPose
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, centre_rows, row_size
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import on_grid
from pipeline.simulation.servos import Demand, DrakePlant, Gains, SaturatedServos, UnsaturatedServos
from pipeline.urdf.description import joint_links
from recorders.errors import ConfigError, JointError, RobotError

_XYZW = [1, 2, 3, 0]  # Drake's quaternions begin with w, those of ROS end with it


@dataclass(frozen=True)
class SimulationConfig:
    """Settings of the simulation.

    Attributes
    ----------
    step_ns : int
        Step of the dynamics [ns].
    control_ns : int
        Period at which lag filter and gravity feed-forward are renewed [ns], a multiple of `step_ns`.
    lag_s : float
        Time constant with which the servos' set point follows the command [s].
    bandwidth : float
        Natural frequency of every servo [rad/s]; critically damped.
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
    answer alike. No motor exerts more than the URDF's effort limit. Implements `pipeline.robot.backend.RobotBackend`.

    What is measured, and the commands that motors take, have the robot's resolution; the state in between has none.

    Raises
    ------
    RobotError
        Drake cannot build the URDF, or finds no motor for a joint.
    """

    def __init__(self, robot: RobotConfig, config: SimulationConfig = SimulationConfig()) -> None:
        logging.getLogger("drake").setLevel(logging.ERROR)  # other remarks are not for our users
        self._robot = robot
        self._config = config
        self._joints = DrakePlant(robot, step_ns=config.step_ns)
        gains = servo_gains(robot, config.bandwidth)
        self._servos = UnsaturatedServos(self._joints, gains)
        self._limited = SaturatedServos(DrakePlant(robot, step_ns=config.step_ns), gains)
        self._plant, self._context = self._joints.plant, self._servos.context
        self._hands = [self._joints.body(hand.link) for hand in robot.hands]
        self._links = list(joint_links(robot.urdf_text).values())  # parent and child
        self._frames = [tuple(self._joints.body(link).body_frame() for link in pair) for pair in self._links]
        self.reset(robot.comfort)

    @property
    def robot(self) -> RobotConfig:
        """The robot being simulated."""
        return self._robot

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]."""
        return self._servos.time_ns

    @property
    def positions(self) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        return on_grid(self._servos.positions, self._robot.resolution.positions)

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        return on_grid(self._servos.velocities, self._robot.resolution.velocities)

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        """Stand still at posture `q` (n,), at a time [ns].

        Raises
        ------
        JointError
            `q` has the wrong shape or is not finite.
        """
        posture = self._checked(q)
        self._set_point = posture
        self._servos.set_state(posture, np.zeros(len(posture)), time_ns=time_ns)

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        """Command posture `q_command` (n,) and simulate `duration_ns`, a multiple of the control period.

        Raises
        ------
        JointError
            `q_command` has the wrong shape or is not finite.
        ConfigError
            `duration_ns` is not a multiple of the control period.
        """
        command = on_grid(self._checked(q_command), self._robot.resolution.commands)
        if duration_ns < 0 or duration_ns % self._config.control_ns:
            period_ns = self._config.control_ns
            raise ConfigError(f"simulation: expected a duration in multiples of {period_ns} ns, found {duration_ns} ns")
        for _ in range(duration_ns // self._config.control_ns):
            self._follow(self._demand(command))

    def hands(self) -> Floats:
        """Hands by row, world frame, shape (hands, row size): positions [m], and orientations where one counts."""
        return on_grid(hand_rows(self._robot, map(self._pose, self._hands)), self._robot.resolution.hands)

    def link_poses(self) -> list[LinkPose]:
        """Pose of every link in its parent link, in the canonical order of the joints."""
        step = self._robot.resolution.tf
        poses_PC = [self._plant.CalcRelativeTransform(self._context, *frames) for frames in self._frames]
        wxyz = np.array([X_PC.rotation().ToQuaternion().wxyz() for X_PC in poses_PC])
        return [
            LinkPose(parent, child, on_grid(X_PC.translation(), step), on_grid(rotation, step))
            for (parent, child), X_PC, rotation in zip(self._links, poses_PC, wxyz[:, _XYZW], strict=True)
        ]

    def _pose(self, body: RigidBody) -> RigidTransform:
        pose: RigidTransform = self._plant.EvalBodyPoseInWorld(self._context, body)
        return pose

    def _checked(self, q: ArrayLike) -> Floats:
        posture = np.array(q, dtype=np.float64)
        if posture.shape != (len(self._robot.joints),):
            raise JointError(f"expected a posture of shape ({len(self._robot.joints)},), found {posture.shape}")
        if not np.isfinite(posture).all():
            name = self._robot.joints[int(np.flatnonzero(~np.isfinite(posture))[0])]
            raise JointError(f"expected a finite position for joint {name}, found {posture}")
        return posture

    def _demand(self, command: Floats) -> Demand:
        """Renew set point and gravity feed-forward for the next control period."""
        gravity = self._joints.gravity(self._context)
        self._set_point, demand = next_demand(command, self._set_point, gravity, self._config)
        return demand

    def _follow(self, demand: Demand) -> None:
        """Simulate a control period: with effort limits only if without them a motor would have exceeded its own."""
        begin_ns, end_ns = self.time_ns, self.time_ns + self._config.control_ns
        if not self._servos.advance(demand, until_ns=end_ns):
            q, v = self._servos.positions, self._servos.velocities
            q, v = self._limited.advance(q, v, demand, time_ns=begin_ns, until_ns=end_ns)
            self._servos.set_state(q, v, time_ns=end_ns)


def hand_rows(robot: RobotConfig, poses: Iterable[RigidTransform]) -> Floats:
    """Return the rows of the hands, shape (hands, row size), that have these poses in the world."""
    if row_size(robot) == POSITION_SIZE:
        return np.array([pose.translation() for pose in poses])
    rows = centre_rows(robot)
    for row, hand, pose in zip(rows, robot.hands, poses, strict=True):
        row[:POSITION_SIZE] = pose.translation()
        if hand.orientation is not None:
            row[POSITION_SIZE:] = pose.rotation().ToQuaternion().wxyz()[_XYZW]
    return rows


def next_demand(command: Floats, set_point: Floats, gravity: Floats, config: SimulationConfig) -> tuple[Floats, Demand]:
    """Return the set point (n,) after the next control period, and the demand on the servos during it.

    Parameters
    ----------
    command, set_point : ndarray
        Posture commanded, and set point so far [rad or m], shape (n,).
    gravity : ndarray
        Gravity's forces on the joints at the beginning of the period [N m or N], shape (n,).
    config : SimulationConfig
        Period and lag.
    """
    period_s = config.control_ns * 1e-9
    step = (command - set_point) * (period_s / (config.lag_s + period_s))
    halfway = set_point + step / 2  # as it stays for the whole period
    with np.errstate(over="ignore"):
        velocities = step / period_s
    return set_point + step, Demand(halfway, velocities, -gravity)


def servo_gains(robot: RobotConfig, bandwidth: float) -> Gains:
    """Gains of critically damped servos of the same natural frequency [rad/s]."""
    inertias = Kinematics(robot).inertia_diagonal(robot.comfort)
    for name, inertia in zip(robot.joints, inertias, strict=True):
        if not inertia > 0.0:  # of a gain below 0 Drake ends the process
            raise RobotError(
                f"robot '{robot.name}': joint {name} moves an inertia of {inertia:g}, expected one above 0: "
                "give the links beyond it masses and moments"
            )
    return Gains(inertias * bandwidth**2, 2.0 * inertias * bandwidth)
