"""A second teacher, on Drake's differential inverse kinematics: every step solves a quadratic program with limits."""

import logging
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.solvers import MathematicalProgram, OsqpSolver

from pipeline.arrays import Floats
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import hand_slices, to_inputs
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.part_distances import PartDistances
from pipeline.teacher.qp_config import SLACK_M, QpTeacherConfig
from pipeline.teacher.teacher import comfort_posture

_DEFAULT = QpTeacherConfig()
_PRIORITY = 100.0  # of the hands before the comfort posture, as in Drake
_INFLUENCE = 2.0  # times the clearance: parts farther from one another are no concern of a step's
_PERIODS = 2.0  # in which the distance may be used up, or is won back
_RETREAT_M_S = 0.2  # at most, where the distance is below the clearance
_PARTS = (1.0, 0.5, 0.25, 0.125)  # of a step that are tried: corners of shapes move along curves
_SINGULAR = 1e-9  # what moves the hands less, relative to what moves them most, moves them not


class QpTeacher:
    """A teacher that moves the hands straight towards their targets, as fast as the limits allow.

    Joint velocities v solve, with hands x(q), as positions and turns, the Jacobian J_i of hand i, and
    an alpha_i from 0 to 1 for each,

        J_i v = alpha_i gain (target_i - x_i),    minimise  |P (v - comfort_gain (comfort - q))|^2 - 100 sum alpha_i,

    where P spans the motions that move no hand. Positions and speeds of the joints stay within limits, and a distance d
    of two parts falls by no more in a period than half of what is left above `clearance_m`; below, half of what is
    missing is won back, if that is possible. Where corners of shapes turn, d is no straight line: a step after which it
    would be 2 mm below is shortened, or not taken at all. Nor is one for which the solver finds nothing.

    The program is that of Drake's `DoDifferentialInverseKinematics`, with a factor for each hand, so that one does not
    wait for the other, and with distances, which cannot be added to it in Python. Drake's newer system has them, but
    lets OSQP adapt itself by the clock; here the same input gives the same output.

    As the first teacher it integrates the posture that it has itself commanded.

    Source: R. Tedrake, "Robotic Manipulation", differential inverse kinematics with constraints,
    https://manipulation.csail.mit.edu/pick.html.

    Parameters
    ----------
    robot : RobotConfig
        The robot; postures have the order of its joints.
    config : QpTeacherConfig
        Settings.
    """

    def __init__(self, robot: RobotConfig, config: QpTeacherConfig = _DEFAULT) -> None:
        logging.getLogger("drake").setLevel(logging.ERROR)  # other remarks are not for our users
        self.config = config
        self.kinematics = Kinematics(robot)
        self._robot = robot
        span = robot.upper - robot.lower
        self._lower, self._upper = robot.lower + config.margin * span, robot.upper - config.margin * span
        self._distances = PartDistances(robot) if config.clearance_m else None
        self._speeds = config.speed_share * robot.speed_limits

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return self.config.period_ns

    def observe(self, robot: RobotBackend) -> None:
        """Take no notice of what was measured: the teacher follows its own commands."""

    def step(self, q: ArrayLike, targets: ArrayLike) -> Floats:
        """Return the posture to command one period after commanding `q` (n,), for `targets` of all hands by row."""
        posture = np.clip(np.asarray(q, dtype=np.float64), self._lower, self._upper)
        goal = np.asarray(targets, dtype=np.float64)
        hands, jacobian = self.kinematics.inputs_and_jacobian(posture)
        wanted = self.config.gain * (to_inputs(self._robot, goal) - hands)
        nominal = np.clip(comfort_posture(self.kinematics, posture, goal), self._lower, self._upper)
        velocity = self._velocity(posture, jacobian, wanted, nominal)
        return self._clear_step(posture, self.period_ns * 1e-9 * velocity)

    def _clear_step(self, q: Floats, step: Floats) -> Floats:
        """Return the posture (n,) after as much of a step (n,) as brings no parts too near to one another."""
        if self._distances is None:
            return np.clip(q + step, self._lower, self._upper)
        floor_m = self.config.clearance_m - SLACK_M
        floor_m = min(floor_m, self._distances.least(q, within_m=floor_m))
        for part in _PARTS:
            posture: Floats = np.clip(q + part * step, self._lower, self._upper)
            if self._distances.least(posture, within_m=max(floor_m, 0.0)) >= floor_m:
                return posture
        return q

    def _velocity(self, q: Floats, jacobian: Floats, wanted: Floats, nominal: Floats) -> Floats:
        """Return joint velocities (n,) at posture `q` (n,), for wanted ones of the hands [m/s or rad/s] (inputs,)."""
        program: Any = MathematicalProgram()  # Any: Drake's types for arrays are not numpy's
        count = len(self._robot.hands)
        velocity, factors = program.NewContinuousVariables(len(q)), program.NewContinuousVariables(count)
        program.AddLinearCost(np.full(count, -_PRIORITY), 0.0, factors)
        null_space = _null_space(jacobian)
        if len(null_space):
            program.Add2NormSquaredCost(null_space, null_space @ (self.config.comfort_gain * (nominal - q)), velocity)
        towards = np.zeros((len(jacobian), count))
        for hand, rows in enumerate(hand_slices(self._robot)):
            towards[rows, hand] = -wanted[rows]
        both = np.concatenate([velocity, factors])
        program.AddLinearEqualityConstraint(np.hstack([jacobian, towards]), np.zeros(len(jacobian)), both)
        program.AddBoundingBoxConstraint(0.0, 1.0, factors)
        self._add_limits(program, velocity, q)
        result: Any = OsqpSolver().Solve(program)
        solution: Floats = result.GetSolution(velocity) if result.is_success() else np.zeros(len(q))
        return solution

    def _add_limits(self, program: Any, velocity: Any, q: Floats) -> None:
        """Add the limits of positions, speeds and distances at posture `q` (n,) to a program."""
        period_s = self.period_ns * 1e-9
        slowest = np.maximum(-self._speeds, (self._lower - q) / period_s)
        fastest = np.minimum(self._speeds, (self._upper - q) / period_s)
        program.AddBoundingBoxConstraint(slowest, fastest, velocity)
        if self._distances is None:
            return
        distances, slopes = self._distances.near(q, within_m=_INFLUENCE * self.config.clearance_m)
        if len(distances):
            nearing = np.minimum((self.config.clearance_m - distances) / (_PERIODS * period_s), _RETREAT_M_S)
            program.AddLinearConstraint(slopes, nearing, np.full(len(distances), np.inf), velocity)


def _null_space(jacobian: Floats) -> Floats:
    """Return an orthonormal basis of the velocities that move no hand, by row, shape (n - rank, n)."""
    _, scales, rows = np.linalg.svd(jacobian)
    basis: Floats = rows[int((scales > _SINGULAR * scales[0]).sum()) :]
    return basis
