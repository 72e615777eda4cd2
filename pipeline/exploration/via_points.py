"""Random via points in the hands' boxes: a motion that explores the whole volume, with the hands clear of the robot."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.collision.self_distance import CLEARANCE_M, NOTHING_NEAR, Nearest, SelfDistance
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig
from pipeline.seeding import uniforms
from pipeline.teacher.teacher import REACH_BOUND_M, Teacher, approach
from recorders.errors import MotionError

VOLUME = "volume"
"""Name of the motion."""
MOVE_NS = 500_000_000
"""Time from one via point to the next [ns]."""
RATES_HZ = (5, 50)
"""Lowest and highest rate of an exploration's ticks [Hz]."""

_PLANNED_CLEARANCE_M = CLEARANCE_M + 0.02  # what noise and the servos' lag take away stays below
_STEP_NS = 20_000_000  # of the planned posture
_ATTEMPTS = 200


class _State(NamedTuple):
    """Where a plan stands: the via point [m] (hands, 3), and the posture commanded there (n,)."""

    point: Floats
    posture: Floats


def volume(
    teacher: Teacher,
    *,
    seed: int,
    duration_ns: int,
    tick_ns: int,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Motion:
    """Make a motion of minimum-jerk moves between random via points, each hand's drawn in its own box.

    A via point is drawn anew where the teacher does not reach it, or comes nearer to the robot's own body than the
    clearance on its way. Targets are made of additions, products and divisions alone, to the nanometre.

    Parameters
    ----------
    teacher : Teacher
        Follows the motion.
    seed : int
        Names the draws.
    duration_ns, tick_ns : int
        Length of the motion and time between its samples [ns].
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    MotionError
        No free way is found from one of the via points.
    """
    robot = teacher.kinematics.robot
    distances = SelfDistance(robot)
    centres, boxes = robot.centres, np.array([hand.box for hand in robot.hands])
    state = _State(centres, approach(teacher, robot.comfort, centres)[0])
    samples: list[Floats] = []
    moves = -(-duration_ns // MOVE_NS)
    for move in range(moves):
        for attempt in range(_ATTEMPTS):
            drawn = uniforms(seed, "via point", move, attempt, count=centres.size).reshape(centres.shape)
            goal = centres + boxes * (2.0 * drawn - 1.0)
            if (after := _follow(teacher, distances, state, goal)) is not None:
                break
        else:
            raise MotionError(
                f"robot '{robot.name}': no way found that keeps its hands {100 * CLEARANCE_M:g} cm from its body, after "
                f"{move} of {moves} moves: make the hands' boxes smaller"
            )
        first = -(-move * MOVE_NS // tick_ns)
        last = -(-min((move + 1) * MOVE_NS, duration_ns) // tick_ns)
        samples += [_between(state.point, goal, (tick * tick_ns - move * MOVE_NS) / MOVE_NS) for tick in range(first, last)]
        state = after
        progress((move + 1) / moves)
    targets = np.array(samples)
    times_s = np.round(tick_ns * 1e-9 * np.arange(len(targets)), 9)
    return Motion(VOLUME, times_s, targets[:, 0], targets[:, 1], closed=False)


def _between(start: Floats, goal: Floats, part: float) -> Floats:
    """Return the point of a minimum-jerk move at a part of its time, 0 to 1.

    Source: T. Flash, N. Hogan, "The coordination of arm movements", 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985.
    """
    blend = part * part * part * (10.0 - 15.0 * part + 6.0 * part * part)
    return np.round(start + (goal - start) * blend, 9)


def _follow(teacher: Teacher, distances: SelfDistance, state: _State, goal: Floats) -> _State | None:
    """Let the teacher go from a via point to the next; return where it then is, or None if the way is not free."""
    posture = state.posture
    limit = Nearest(_PLANNED_CLEARANCE_M, "", "")
    for step in range(1, MOVE_NS // _STEP_NS + 1):
        posture = teacher.step_for(posture, _between(state.point, goal, step * _STEP_NS / MOVE_NS), _STEP_NS * 1e-9)
        if distances.nearest(posture, below=limit) is not limit:
            return None
    settled, short_m = approach(teacher, posture, goal)
    free = distances.nearest(settled, below=limit) is limit
    return _State(goal, posture) if free and short_m.max() <= REACH_BOUND_M else None
