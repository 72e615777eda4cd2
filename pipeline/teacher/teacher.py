"""The teacher: whole-body motion control of the hands by resolved rates, after Gienger et al. 2005."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.motions.motion import Motion
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, to_inputs, to_rows, turns_of
from pipeline.robot.kinematics import Kinematics
from pipeline.rotations import turns_between
from recorders.errors import ConfigError, MotionError
from recorders.text.wording import hand_label

REACH_BOUND_M = 0.005  # farther than this is out of reach: half of what learning is to achieve
_LEVER_M = 0.1  # from a hand's origin to the point that a turn moves
_REACH_PERIOD_S = 0.05  # the hands come 30 % nearer in a step; longer ones make the null-space motion overshoot
_REACH_STEPS = 200  # within reach about 5 suffice


@dataclass(frozen=True)
class TeacherConfig:
    """Settings of the teacher.

    Attributes
    ----------
    period_ns : int
        Control period [ns].
    gain : float
        Approach of the hands to their targets, kp [1/s].
    damping : float
        lambda of the damped inverse; bounds joint speeds near singular postures.
    comfort_gain : float
        Approach to the comfort posture within the null space, alpha [1/s]; below 1 postures drift from cycle to cycle,
        at 0 by up to 58 % of a joint's range.
    barrier : float
        Weight of the log barrier at the joint limits, relative to the comfort term.
    margin : float
        Smallest distance kept from a limit, as a part of the joint's range.
    speed_share : float
        Largest speed of a joint, as a part of the limit in the URDF; 0 for no limit.
    """

    period_ns: int = 5_000_000
    gain: float = 6.0
    damping: float = 0.02
    comfort_gain: float = 5.0
    barrier: float = 0.01
    margin: float = 1e-3
    speed_share: float = 0.0

    def __post_init__(self) -> None:
        for name in ("period_ns", "gain", "damping"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"teacher {name}: expected above 0, found {getattr(self, name)}")
        for name in ("comfort_gain", "barrier", "speed_share"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"teacher {name}: expected at least 0, found {getattr(self, name)}")
        if not 0 < self.margin < 0.5:
            raise ConfigError(f"teacher margin: expected between 0 and 0.5, found {self.margin}")


class Teacher:
    """A velocity-level inverse kinematics that resolves redundancy by comfort.

    With hands x(q), as their positions and, where the pose is controlled, turns from the middle, their Jacobian J and a
    cost H(q) of postures, the joints move at

        qd = z + J# (xd - J z),    J# = W^-1 J^T (J W^-1 J^T + lambda^2 I)^-1,    z = -alpha W^-1 grad H,

    where xd = kp (target - x). H is the squared distance from the comfort posture, in parts of each joint's range and
    weighted by joint, plus a log barrier at the limits; W is the diagonal of its Hessian. The teacher integrates the
    posture it has itself commanded, not the measured one: what the robot's lag does to a motion stays in the data.

    Source: M. Gienger, H. Janssen, C. Goerick, "Task-oriented whole body motion for humanoid robots", Humanoids 2005,
    doi:10.1109/ICHR.2005.1573574.
    """

    def __init__(self, kinematics: Kinematics, config: TeacherConfig = TeacherConfig()) -> None:
        self.kinematics = kinematics
        self.config = config
        robot = kinematics.robot
        span = robot.upper - robot.lower
        self._stiffness = robot.weights / span**2  # (n,)
        self._lower = robot.lower + config.margin * span
        self._upper = robot.upper - config.margin * span
        self._speeds = config.speed_share * robot.speed_limits if config.speed_share else np.inf
        self._damping = config.damping**2 * np.eye(robot.input_centre.size)

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return self.config.period_ns

    def observe(self, robot: RobotBackend) -> None:
        """Take no notice of what was measured: the teacher follows its own commands."""

    def step(self, q: ArrayLike, targets: ArrayLike) -> Floats:
        """Return the posture to command one period after commanding `q` (n,), for `targets` of all hands by row."""
        return self.step_for(q, targets, self.config.period_ns * 1e-9)

    def step_for(self, q: ArrayLike, targets: ArrayLike, period_s: float) -> Floats:
        """Return the posture as `step` does, with a given period [s]."""
        posture, goal = self._within(np.asarray(q, dtype=np.float64)), np.asarray(targets, dtype=np.float64)
        gradient, hessian = self._cost(posture, self._within(comfort_posture(self.kinematics, posture, goal)))
        hands, jacobian = self.kinematics.inputs_and_jacobian(posture)
        z = gradient / hessian * -self.config.comfort_gain  # (n,)
        xd = self.config.gain * (to_inputs(self.kinematics.robot, goal) - hands)
        weighted = jacobian / hessian  # J W^-1, (inputs, n)
        qd = z + np.linalg.solve(weighted @ jacobian.T + self._damping, xd - jacobian @ z) @ weighted
        return self._within(posture + period_s * np.clip(qd, -self._speeds, self._speeds))

    def _within(self, q: Floats) -> Floats:
        within: Floats = np.minimum(np.maximum(q, self._lower), self._upper)
        return within

    def _cost(self, q: Floats, comfort: Floats) -> tuple[Floats, Floats]:
        """Gradient and diagonal Hessian of H at `q`, both (n,)."""
        below, above = 1.0 / (q - self.kinematics.lower), 1.0 / (self.kinematics.upper - q)
        gradient = self._stiffness * (q - comfort) + self.config.barrier * (above - below)
        hessian = self._stiffness + self.config.barrier * (above * above + below * below)
        return gradient, hessian


def comfort_posture(kinematics: Kinematics, q: Floats, targets: Floats) -> Floats:
    """Return the comfort posture (n,), its gaze joint, if any, turned to the middle of the targets, (hands, 3 or 7).

    The turn is measured at posture `q` (n,); it is not kept within the joint's limits.
    """
    comfort, robot = kinematics.robot.comfort.copy(), kinematics.robot
    if robot.gaze is not None:
        gaze = robot.joints.index(robot.gaze.joint)
        ahead, aside, _ = kinematics.in_gaze_frame(q, targets[:, :POSITION_SIZE].mean(axis=0))
        comfort[gaze] = q[gaze] + math.atan2(aside, ahead)
    return comfort


@dataclass(frozen=True)
class Unreachable:
    """The first sample of a motion that a hand does not reach.

    Attributes
    ----------
    sample : int
        Index of the sample.
    hand : str
        Its name.
    point : (float, float, float)
        The target [m].
    short_m : float
        Distance that remains [m].
    """

    sample: int
    hand: str
    point: tuple[float, float, float]
    short_m: float


def find_unreachable(teacher: Teacher, targets: ArrayLike, *, bound_m: float = REACH_BOUND_M) -> Unreachable | None:
    """Find the first of the `targets`, by row (T, hands, 3 or 7), from which a hand stays farther than `bound_m`.

    The teacher runs along the targets kinematically, on each until it is there or has had time to converge.
    """
    q = teacher.kinematics.robot.comfort
    for sample, target in enumerate(np.asarray(targets, dtype=np.float64)):
        q, short_m = approach(teacher, q, target, bound_m)
        hand = int(np.argmax(short_m))
        if short_m[hand] > bound_m:
            x, y, z = (float(value) for value in target[hand][:POSITION_SIZE])
            return Unreachable(sample, teacher.kinematics.robot.hand_names[hand], (x, y, z), float(short_m[hand]))
    return None


def check_reach(teacher: Teacher, motion: Motion) -> None:
    """Check that all hands can reach every sample of a motion.

    Raises
    ------
    MotionError
        They cannot; the message names sample, hand, point and the distance that remains.
    """
    if miss := find_unreachable(teacher, motion.targets):
        point = ", ".join(f"{value:.3f}" for value in miss.point)
        raise MotionError(
            f"motion '{motion.name}' is out of reach: at sample {miss.sample} (t = {motion.times_s[miss.sample]:g} s) "
            f"the {hand_label(miss.hand)} of '{teacher.kinematics.robot.name}' stays {100 * miss.short_m:.1f} cm short "
            f"of ({point}) m"
        )


def approach(teacher: Teacher, q: Floats, target: Floats, bound_m: float = REACH_BOUND_M) -> tuple[Floats, Floats]:
    """Let the teacher go from posture `q` (n,) towards targets by row until all hands are there, or it converged.

    Returns
    -------
    (ndarray, ndarray)
        Posture reached (n,), and what each hand misses its target by [m], see `misses_m`; above `bound_m` is out of
        reach.
    """
    robot = teacher.kinematics.robot
    for _ in range(_REACH_STEPS):
        short_m = misses_m(robot, to_rows(robot, teacher.kinematics.inputs(q)), target)
        if short_m.max() <= bound_m:
            break
        q = teacher.step_for(q, target, _REACH_PERIOD_S)
    return q, short_m


def misses_m(robot: RobotConfig, rows: Floats, targets: Floats) -> Floats:
    """Return how far each hand is from its target [m], shape (hands,); both come by row, (hands, 3 or 7).

    Where the pose is controlled, that is no less than the way of a point 10 cm from the hand's origin by the turn that
    is missing.
    """
    far_m: Floats = np.linalg.norm(rows[:, :POSITION_SIZE] - targets[:, :POSITION_SIZE], axis=1)
    found, asked = (turns_of(robot, to_inputs(robot, hands)) for hands in (rows, targets))
    for hand, turn in found.items():
        place = robot.hand_names.index(hand)
        far_m[place] = max(far_m[place], _LEVER_M * float(turns_between(turn, asked[hand])))
    return far_m
