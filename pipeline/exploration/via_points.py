"""Via points: random targets in the hands' boxes, and the minimum-jerk moves between them.

Targets are made of additions, products and divisions alone, to the nanometre.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import positions_of, to_rows
from pipeline.seeding import uniforms

VOLUME = "volume"
"""Name of the motion, and of its source."""
MOVE_NS = 500_000_000
"""Time from one via point to the next [ns]."""

_HANDS_APART_M = 0.1
_DRAWS = 40


def unplanned_volume(robot: RobotConfig, *, seed: int, duration_ns: int, tick_ns: int) -> Motion:
    """Make a motion for a robot that nothing is known of: its via points keep the hands apart, and no more.

    Parameters
    ----------
    robot : RobotConfig
        Its boxes.
    seed, duration_ns, tick_ns : int
        As of the planned one.
    """
    points = [robot.input_centre]
    for move in range(-(-duration_ns // MOVE_NS)):
        drawn = (draw_point(robot, seed, move + 1, attempt) for attempt in range(_DRAWS))
        apart = (goal for goal in drawn if _are_apart(*(positions_of(robot, point) for point in (points[-1], goal))))
        points.append(next(apart, robot.input_centre))
    return motion_through(robot, points, duration_ns, tick_ns)


def motion_through(robot: RobotConfig, points: Sequence[Floats], duration_ns: int, tick_ns: int) -> Motion:
    """Return the motion of so many moves from point to point, each (inputs,)."""
    ticks = range(0, duration_ns, tick_ns)
    parts = [divmod(tick, MOVE_NS) for tick in ticks]
    inputs = np.array([between(points[move], points[move + 1], since / MOVE_NS) for move, since in parts])
    return Motion(VOLUME, np.round(np.array(ticks) * 1e-9, 9), to_rows(robot, inputs), closed=False)


def draw_point(robot: RobotConfig, seed: int, number: int, attempt: int) -> Floats:
    """Draw a via point of all hands: positions [m], and turns [rad] where the pose is controlled, (inputs,)."""
    drawn = uniforms(seed, "via point", number, attempt, count=robot.input_reach.size)
    point: Floats = robot.input_centre + robot.input_reach * (2.0 * drawn - 1.0)
    return point


def _are_apart(start: Floats, goal: Floats) -> bool:
    """Return whether no two hands come too near to each other on the way between positions [m], (hands, 3) each."""
    way = start + np.linspace(0.0, 1.0, 11)[:, np.newaxis, np.newaxis] * (goal - start)  # (11, hands, 3)
    pairs = combinations(range(len(start)), 2)
    return all(((way[:, one] - way[:, other]) ** 2).sum(axis=1).min() >= _HANDS_APART_M**2 for one, other in pairs)


def between(start: Floats, goal: Floats, part: float) -> Floats:
    """Return the point of a minimum-jerk move at a part of its time, 0 to 1.

    Source: T. Flash, N. Hogan, "The coordination of arm movements", 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985.
    """
    blend = part * part * part * (10.0 - 15.0 * part + 6.0 * part * part)
    return np.round(start + (goal - start) * blend, 9)
