"""Exploration without a teacher: the learner follows targets with what it has learned of its own hands so far."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.collision.self_distance import CLEARANCE_M, Nearest, SelfDistance
from pipeline.learner.body import body_of
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.learner.state import state_digest
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import to_inputs
from pipeline.seeding import uniforms
from recorders.errors import ConfigError

_CLEAR = Nearest(CLEARANCE_M + 0.015, "", "")  # what noise and the servos' lag take away stays below the difference
_POINTS = 128  # of the hands' boxes, at which the error is predicted


@dataclass(frozen=True)
class SelfExplorerConfig:
    """Settings of an exploration without a teacher.

    Attributes
    ----------
    period_ns : int
        Control period, and time from tick to tick [ns].
    jitter_ticks : int
        Ticks at the beginning, in which the joints move at random about the comfort posture: a first idea of the hands.
    jitter : float
        Size of these motions, in parts of each joint's range.
    gain : float
        Approach of the hands to their targets [1/s].
    home_gain : float
        Approach to the comfort posture where it moves no hand [1/s].
    damping : float
        lambda^2 of the damped inverse, in parts of the mean diagonal of J J'.
    margin : float
        Smallest distance kept from a limit, in parts of the joint's range.
    speed_share : float
        Largest speed of a joint, as a part of the limit in the URDF.
    """

    period_ns: int = 40_000_000
    jitter_ticks: int = 40
    jitter: float = 0.02
    gain: float = 6.0
    home_gain: float = 5.0
    damping: float = 1e-3
    margin: float = 0.02
    speed_share: float = 0.7

    def __post_init__(self) -> None:
        for name in ("period_ns", "jitter_ticks", "jitter", "gain", "home_gain", "damping", "margin", "speed_share"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"self explorer {name}: expected above 0, found {getattr(self, name)}")


class SelfExplorer:
    """A learner that leads the robot through the motion that it learns from.

    It knows of the robot what the learner knows: limits of the joints, and which of them move which hand. It begins
    with small random motions about the comfort posture. Then it follows targets by resolved rates on the learned
    forward models F,

        qd = J# (gain (u - F(q)) - J h) + h,    h = home_gain (comfort - q),    J = dF/dq,

    in units of half of each joint's range. q is the posture commanded, not the one measured: the servos' lag stays out
    of what is corrected. Where the robot's shapes would come too near to one another it goes back towards the comfort
    posture. At every tick it learns from the hands and joints measured there.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    seed : int
        Names the first motions.
    config : SelfExplorerConfig
        Settings.
    """

    def __init__(self, robot: RobotConfig, *, seed: int, config: SelfExplorerConfig = SelfExplorerConfig()) -> None:
        self.config = config
        self._robot = robot
        self._seed = seed
        learner = ForwardInverseConfig().with_body(body_of(robot))
        self._inputs = learner.inputs
        centre = np.concatenate([robot.input_centre, robot.comfort])
        self.learner = ForwardInverseLearner(learner, input_centre=robot.input_centre, output_centre=centre)
        self._half = (robot.upper - robot.lower) / 2.0
        self._lower = robot.lower + 2.0 * config.margin * self._half
        self._upper = robot.upper - 2.0 * config.margin * self._half
        self._speeds = config.speed_share * robot.speed_limits
        self._distances = SelfDistance(robot)
        self._points = _box_points(robot)
        self.ticks = 0

    @property
    def period_ns(self) -> int:
        """Control period, and time from tick to tick [ns]."""
        return self.config.period_ns

    @property
    def digest(self) -> str:
        """Digest of the learner's state."""
        return state_digest(self.learner.state())

    @property
    def predicted_cm(self) -> float:
        """Error of the hands that the learner expects of itself [cm], mean over their boxes; infinite at first."""
        return 100.0 * float(self.learner.deviations(self._points).mean())

    def observe(self, robot: RobotBackend) -> None:
        """Learn from hands and joints that the robot measures at a tick."""
        u = to_inputs(self._robot, robot.hands()).reshape(1, self._inputs)
        self.learner.step(u, np.concatenate([u, robot.positions[np.newaxis]], axis=1), learning=True)
        self.ticks += 1

    def step(self, q: Floats, targets: Floats) -> Floats:
        """Return the posture to command next, one period after commanding `q` (n,), for `targets` by row."""
        if self.ticks == 0:
            return self._robot.comfort
        if self.ticks <= self.config.jitter_ticks:
            drawn = uniforms(self._seed, "first motions", self.ticks, count=len(q))
            return self._robot.comfort + 2.0 * self.config.jitter * self._half * (2.0 * drawn - 1.0)
        hands, jacobian = self.learner.linearise(q)
        scaled = jacobian * self._half
        home = self.config.home_gain * (self._robot.comfort - q) / self._half
        wanted = self.config.gain * (to_inputs(self._robot, targets) - hands) - scaled @ home
        square = scaled @ scaled.T
        square += self.config.damping * np.trace(square) / len(square) * np.eye(len(square))
        following = self._moved(q, self._half * (home + scaled.T @ np.linalg.solve(square, wanted)))
        if self._is_clear(q, following):
            return following
        back = self._moved(q, self._half * home)
        return back if self._is_clear(q, back) else q

    def _moved(self, q: Floats, speeds: Floats) -> Floats:
        """Return the posture one period after `q` at such speeds, within the limits of both."""
        moved = q + self.config.period_ns * 1e-9 * np.clip(speeds, -self._speeds, self._speeds)
        within: Floats = np.clip(moved, self._lower, self._upper)
        return within

    def _is_clear(self, q: Floats, following: Floats) -> bool:
        """Return whether a posture is not too near to the robot itself, or at least no nearer than `q`."""
        found = self._distances.nearest(following, below=_CLEAR)
        return found is _CLEAR or found.distance_m >= self._distances.nearest(q).distance_m

    def until(self, error_cm: float) -> Callable[[], bool]:
        """Return a check of whether the predicted error is below a bound [cm]; it looks once in a second."""
        every = max(1, 1_000_000_000 // self.config.period_ns)
        return lambda: self.ticks % every == 0 and self.predicted_cm < error_cm


def learned(guide: object) -> dict[str, str | float]:
    """Return what is reported of a guide that learns: its digest, and the error that it expects; nothing of others."""
    return {"digest": guide.digest, "predicted_cm": guide.predicted_cm} if isinstance(guide, SelfExplorer) else {}


def _box_points(robot: RobotConfig) -> Floats:
    """Return points spread evenly over the boxes of all hands, shape (points, inputs)."""
    from scipy.stats import qmc  # noqa: PLC0415  # an extra, and slow to import: only who explores alone needs it

    unit = qmc.Halton(d=robot.input_reach.size, scramble=False).random(_POINTS + 1)[1:]  # the first is a corner
    points: Floats = robot.input_centre + robot.input_reach * (2.0 * unit - 1.0)
    return points
