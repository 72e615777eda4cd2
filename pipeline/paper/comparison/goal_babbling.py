"""Baseline: goal babbling, an inverse model that learns from its own attempts to reach, without a teacher.

M. Rolf, J. J. Steil and M. Gienger, "Goal babbling permits direct learning of inverse kinematics", IEEE Transactions on
Autonomous Mental Development 2 (2010), doi:10.1109/TAMD.2010.2062511; learned online, sample by sample, as the same
authors do in "Online goal babbling for rapid bootstrapping of inverse models in high dimensions", ICDL 2011,
doi:10.1109/DEVLRN.2011.6037368.

The robot is its kinematics alone: it is where it is told to be at once, which favours the baseline. Hands are in units
of their boxes, joints in units of half their ranges.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from pipeline.arrays import Floats
from pipeline.paper.comparison.regressions import Answer
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.seeding import uniforms

TICK_RATE_HZ = 25
"""As of the rule forward-inverse, where it explores without a teacher."""

_HALF_A_BIT = 2.0**-54  # what is drawn is a multiple of 2^-53 from 0 on, which has no normal deviate


@dataclass(frozen=True)
class GoalBabblingConfig:
    """Settings, of some dozen that were tried on the motions of the comparison those that did best.

    Attributes
    ----------
    ticks : int
        Ticks from one goal to the next.
    home_share : float
        How often the robot goes home, to its comfort posture, in place of to a goal.
    noise, noise_step : float
        Standard deviations of the numbers that the exploratory noise is made of, and of their change in a tick.
    radius : float
        Distance at which a new local model begins.
    rate : float
        Learning rate.
    """

    ticks: int = 12
    home_share: float = 0.1
    noise: float = 0.05
    noise_step: float = 0.02
    radius: float = 1.0
    rate: float = 0.3


_DEFAULT = GoalBabblingConfig()


class LocalLinearMap:
    """Sum of linear models, each about a prototype p_k, weighted by exp(-|(x - p_k) / radius|^2).

    It begins as a constant. Where an input is farther than `radius` from all prototypes it gets a model of its own, the
    tangent of the map there, so that the map hardly changes.

    Parameters
    ----------
    x, q : ndarray
        The first prototype (v,) and what is answered everywhere at first (n,).
    radius, rate : float
        Distance between prototypes, and learning rate.
    """

    def __init__(self, x: Floats, q: Floats, *, radius: float, rate: float) -> None:
        self._radius, self._rate = radius, rate
        self._prototypes = x[np.newaxis].copy()  # (k, v)
        self._offsets = q[np.newaxis].copy()  # (k, n)
        self._slopes = np.zeros((1, len(q), len(x)))  # (k, n, v)

    def __call__(self, x: Floats) -> Floats:
        """Return the answer (n,) to an input (v,)."""
        apart, shares = self._shares(x)
        answers: Floats = shares @ (self._offsets + (self._slopes @ apart[:, :, np.newaxis])[:, :, 0])
        return answers

    def learn(self, x: Floats, q: Floats, weight: float) -> None:
        """Descend the gradient of `weight` |q - answer(x)|^2 by one step."""
        if (self._shares(x)[0] ** 2).sum(axis=1).min() > 1.0:
            self._begin_model(x)
        apart, shares = self._shares(x)
        step = self._rate * weight * np.outer(shares, q - self(x))  # (k, n)
        self._offsets += step
        self._slopes += step[:, :, np.newaxis] * apart[:, np.newaxis, :]

    def _shares(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the distances from the prototypes in radii (k, v), and the share of each model (k,)."""
        apart = (x - self._prototypes) / self._radius
        squares = (apart**2).sum(axis=1)
        weights = np.exp(squares.min() - squares)
        return apart, weights / weights.sum()

    def _begin_model(self, x: Floats, delta: float = 1e-4) -> None:
        ways = delta * np.eye(len(x))
        tangent = np.array([self(x + way) - self(x - way) for way in ways]).T / (2.0 * delta)  # (n, v)
        self._offsets = np.vstack([self._offsets, self(x)])
        self._prototypes = np.vstack([self._prototypes, x])
        self._slopes = np.concatenate([self._slopes, self._radius * tangent[np.newaxis]])


def goal_babbling(robot: RobotConfig, *, seed: int, duration_s: float, config: GoalBabblingConfig = _DEFAULT) -> Answer:
    """Explore and learn for so long a time of the robot; return what was learned.

    Parameters
    ----------
    robot : RobotConfig
        Its boxes are where goals are drawn.
    seed : int
        Names the draws.
    duration_s : float
        Length [s], of ticks at `TICK_RATE_HZ`.
    config : GoalBabblingConfig
        Settings.

    Returns
    -------
    callable
        Joints [rad or m] (T, n) to targets [m] (T, v).
    """
    babbler = _Babbler(robot, seed, config)
    moves = -(-round(duration_s * TICK_RATE_HZ) // config.ticks)
    for move in range(moves):
        babbler.move(move, ticks=min(config.ticks, round(duration_s * TICK_RATE_HZ) - move * config.ticks))
    return babbler.answer


class _Babbler:
    """A robot that tries to reach goals with what it has learned so far, and learns from what it reaches."""

    def __init__(self, robot: RobotConfig, seed: int, config: GoalBabblingConfig) -> None:
        self._robot, self._seed, self._config = robot, seed, config
        self._kinematics = Kinematics(robot)
        self._half, self._boxes = (robot.upper - robot.lower) / 2.0, robot.boxes.ravel()
        self._home = np.zeros(len(robot.joints))
        self._posture, self._goal = self._home, self._hands(self._home)
        self._reached = self._goal
        self._inverse = LocalLinearMap(self._goal, self._home, radius=config.radius, rate=config.rate)
        self._noise = self._noise_walk()

    def answer(self, targets: Floats) -> Floats:
        """Return joints [rad or m] (T, n) to targets [m] (T, v), within the limits."""
        scaled = (targets - self._robot.input_centre) / self._boxes
        return np.array([self._within(self._robot.comfort + self._half * self._inverse(one)) for one in scaled])

    def move(self, number: int, *, ticks: int) -> None:
        """Go to a new goal on a straight way, or home, and learn at every tick."""
        start, begin = self._goal, self._posture
        goes_home = float(uniforms(self._seed, "home", number, count=1)[0]) < self._config.home_share
        drawn = 2.0 * uniforms(self._seed, "goal", number, count=len(self._boxes)) - 1.0
        self._goal = self._hands(self._home) if goes_home else drawn
        for tick in range(1, ticks + 1):
            part, noise = tick / self._config.ticks, next(self._noise)
            target = start + (self._goal - start) * part
            tried = self._inverse(target) + noise[:, :-1] @ target + noise[:, -1]
            self._learn(begin + (self._home - begin) * part if goes_home else tried, self._goal - start, goes_home)

    def _learn(self, posture: Floats, way: Floats, goes_home: bool) -> None:
        """Move to a posture and learn it, weighted by how efficiently and how far along the way it brought the hands.

        On the way home there is no target to be led by, and the weight is that of efficiency alone.
        """
        posture = (self._within(self._robot.comfort + self._half * posture) - self._robot.comfort) / self._half
        reached = self._hands(posture)
        moved, turned = reached - self._reached, float(np.linalg.norm(posture - self._posture))
        length = float(np.linalg.norm(moved))
        if length > 0.0 and turned > 0.0:
            along = 1.0 if goes_home else float(moved @ way) / (length * float(np.linalg.norm(way)))
            self._inverse.learn(reached, posture, 0.5 * (1.0 + along) * length / turned)
        self._posture, self._reached = posture, reached

    def _hands(self, posture: Floats) -> Floats:
        hands = self._kinematics.hands(self._robot.comfort + self._half * posture)
        scaled: Floats = (hands.ravel() - self._robot.input_centre) / self._boxes
        return scaled

    def _within(self, joints: Floats) -> Floats:
        return np.clip(joints, self._robot.lower, self._robot.upper)

    def _noise_walk(self) -> Iterator[Floats]:
        """Yield offsets of the joints as linear functions of the target (n, v + 1), which drift slowly, without end."""
        shape, config = (len(self._home), len(self._boxes) + 1), self._config
        keep = config.noise / float(np.hypot(config.noise, config.noise_step))
        walk, tick = config.noise * self._normal(0, shape), 0
        while True:
            tick += 1
            walk = keep * (walk + config.noise_step * self._normal(tick, shape))
            yield walk

    def _normal(self, tick: int, shape: tuple[int, int]) -> Floats:
        drawn = uniforms(self._seed, "babbling noise", tick, count=shape[0] * shape[1])
        return np.asarray(ndtri(drawn + _HALF_A_BIT)).reshape(shape)
