"""Random via points in the hands' boxes: a motion that explores the whole volume, with the hands clear of the robot."""

from collections.abc import Callable, Iterator
from itertools import repeat
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.collision.self_distance import CLEARANCE_M, Nearest, SelfDistance
from pipeline.exploration.episode import ExplorationConfig
from pipeline.exploration.source import JOINT_NOISE, DrawnMotion
from pipeline.exploration.via_points import MOVE_NS, VOLUME, between, draw_point, motion_through
from pipeline.motions.motion import Motion
from pipeline.robot.coordinates import to_rows
from pipeline.teacher.teacher import REACH_BOUND_M, Teacher, TeacherConfig, approach
from recorders.errors import MotionError

_LAG_SHARE, _HELD_LAG_SHARE = 0.02, 0.008  # of the widest box: what the servos' lag takes away stays below it
_STEP_NS = 20_000_000  # of the planned posture
_HOLD_NS = 200_000_000  # the longest that a target is held, at 5 Hz
_DRAWS = 40  # of a via point, before the one before is drawn anew; on average, of each


class _State(NamedTuple):
    """Position of a plan.

    Attributes
    ----------
    point : ndarray
        The via point, shape (inputs,).
    posture : ndarray
        The posture commanded there (n,), if targets flow.
    target, held : ndarray
        If each target is held: the last of them, shape (inputs,), and the posture commanded there (n,).
    """

    point: Floats
    posture: Floats
    target: Floats
    held: Floats


def volume(
    teacher: Teacher,
    *,
    seed: int,
    duration_ns: int,
    tick_ns: int,
    noise: Iterator[Floats] | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Motion:
    """Make a motion of minimum-jerk moves between random via points, each hand's drawn in its own box.

    A via point is drawn anew where the teacher does not reach it, or comes nearer to the robot's own body than the
    clearance on its way: with targets that flow, as at 50 Hz, or that are held, as at 5 Hz, so that both rates have the
    same via points. Targets are made of additions, products and divisions alone, to the nanometre.

    Parameters
    ----------
    teacher : Teacher
        Follows the motion.
    seed : int
        Names the draws.
    duration_ns, tick_ns : int
        Length of the motion and time between its samples [ns].
    noise : iterator of array, optional
        Offsets that will be added to the commands, period by period of the teacher, (n,).
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    MotionError
        No free way is found from one of the via points.
    """
    moves = -(-duration_ns // MOVE_NS)
    points = _Planner(teacher, seed, noise).via_points(moves, progress)
    return motion_through(teacher.kinematics.robot, points, duration_ns, tick_ns)


class _Planner:
    """Draws via points, and follows them as the teacher and the noise will, without the robot."""

    def __init__(self, teacher: Teacher, seed: int, noise: Iterator[Floats] | None) -> None:
        self._teacher = teacher
        self._seed = seed
        self._robot = teacher.kinematics.robot
        self._distances = SelfDistance(self._robot)
        self._noise = repeat(np.zeros(len(self._robot.joints))) if noise is None else noise
        self._offsets: list[Floats] = []  # of the commands, by step
        widest_m = float(self._robot.boxes.max())
        self._clear = Nearest(CLEARANCE_M + _LAG_SHARE * widest_m, "", "")
        self._clear_held = Nearest(CLEARANCE_M + _HELD_LAG_SHARE * widest_m, "", "")

    def via_points(self, moves: int, progress: Callable[[float], None]) -> list[Floats]:
        """Return the centres of the boxes and as many via points as there are moves, each (inputs,)."""
        centre = self._robot.input_centre
        start = approach(self._teacher, self._robot.comfort, to_rows(self._robot, centre))[0]
        way = [_State(centre, start, centre, start)]
        drawn = [0]  # how many points, by move
        for _ in range(_DRAWS * (moves + 1)):
            if len(way) > moves:
                return [state.point for state in way]
            after = self._follow(way[-1], draw_point(self._robot, self._seed, len(way), drawn[-1]), move=len(way) - 1)
            drawn[-1] += 1
            if after is not None:
                way.append(after)
                drawn.append(0)
                progress(len(way) / (moves + 1))
            elif drawn[-1] >= _DRAWS and len(way) > 1:  # no way on from here: draw the point before anew
                way.pop()
                drawn.pop()
        raise MotionError(
            f"robot '{self._robot.name}': found no way for hands that keep {100 * CLEARANCE_M:g} cm from its body, "
            f"after {len(way) - 1} of {moves} moves: make the hands' boxes smaller"
        )

    def _follow(self, state: _State, goal: Floats, *, move: int) -> _State | None:
        """Go from a via point to the next; return where that ends, or None if the way is not free."""
        posture, steps = state.posture, MOVE_NS // _STEP_NS
        for step in range(1, steps + 1):
            posture = self._step(posture, between(state.point, goal, step / steps))
            if not self._is_free(posture + self._offset(move * steps + step), self._clear):
                return None
        settled, short_m = approach(self._teacher, posture, to_rows(self._robot, goal))
        if short_m.max() > REACH_BOUND_M or not self._is_free(settled, self._clear):
            return None
        return self._follow_held(_State(goal, posture, state.target, state.held), state.point, move=move)

    def _follow_held(self, state: _State, point: Floats, *, move: int) -> _State | None:
        """Go the same way with held targets from a via point (inputs,); `state` is where it ends without."""
        target, held, steps = state.target, state.held, MOVE_NS // _STEP_NS
        for step in range(steps):
            if (move * steps + step) % (_HOLD_NS // _STEP_NS) == 0:
                target = between(point, state.point, step / steps)
            held = self._step(held, target)
            if not self._is_free(held + self._offset(move * steps + step + 1), self._clear_held):
                return None
        return state._replace(target=target, held=held)

    def _step(self, posture: Floats, target: Floats) -> Floats:
        return self._teacher.step_for(posture, to_rows(self._robot, target), _STEP_NS * 1e-9)

    def _is_free(self, posture: Floats, clear: Nearest) -> bool:
        return self._distances.nearest(posture, below=clear) is clear

    def _offset(self, step: int) -> Floats:
        """Noise of the command at a step of the plan."""
        while len(self._offsets) <= step:
            self._offsets.append(next(self._noise))
            for _ in range(_STEP_NS // self._teacher.config.period_ns - 1):
                next(self._noise)
        return self._offsets[step]


# The least lag in the null space, and joints that vary on their own: what a model is learned from.
SOURCE = DrawnMotion(
    VOLUME,
    volume,
    teacher=TeacherConfig(comfort_gain=20.0, speed_share=0.7),
    config=ExplorationConfig(joint_noise=JOINT_NOISE),
)
