"""Both teachers on the same motions, on the simulated robot: error, limits, comfort, distance and time of a step."""

import statistics
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.episode import Guidance, Guide
from pipeline.exploration.explore import explore
from pipeline.exploration.source import source
from pipeline.exploration.via_points import VOLUME
from pipeline.paper.comparison.explorations import with_step
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig, load_robot
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import JointMap, join_ticks

TAUGHT_MOTIONS: Mapping[str, float | None] = {"circles": None, "right_hand_drawing": None, VOLUME: 20.0}
"""Motions that both teachers follow, with the length [s] of one that is drawn."""


@dataclass(frozen=True)
class TeacherTrial:
    """A teacher on a motion.

    Attributes
    ----------
    teacher, motion : str
        Their names.
    error_cm : float
        Distance of the hands from each target at the end of its hold [cm], mean.
    limit_margin : float
        Smallest distance of a joint from a limit, in parts of its range.
    joint_speed : float
        Largest speed of a joint, in parts of its limit.
    comfort : float
        Cost of leaving the comfort posture, see `comfort_cost`.
    self_distance_cm : float or None
        Smallest distance between hands or forearms and other parts of the robot [cm]; None if nothing is checked.
    step_us : float
        Time of one step [us], the median.
    """

    teacher: str
    motion: str
    error_cm: float
    limit_margin: float
    joint_speed: float
    comfort: float
    self_distance_cm: float | None
    step_us: float

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self)


def try_teacher(
    teacher: str,
    motion: str,
    *,
    robot_name: str,
    seed: int,
    folder: Path,
    duration_s: float | None = None,
    step_ns: int | None = None,
) -> TeacherTrial:
    """Let a teacher follow a motion with the settings of `explore`, however near the robot comes to itself.

    Parameters
    ----------
    teacher, motion, robot_name : str
        Names.
    seed : int
        Seed of the exploration.
    folder : Path
        Where the log goes, over one that is there.
    duration_s : float, optional
        Length of a motion that is drawn [s].
    step_ns : int, optional
        Period of teacher and simulation [ns] of a coarse run; their own if left out.

    Raises
    ------
    ReenactError
        If the motion is not within reach, or the log cannot be written.
    """
    robot = load_robot(robot_name)
    way, simulation = with_step(source(motion, teacher=teacher, duration_s=duration_s), step_ns)
    guide = _Timed(way.guide(robot, seed=seed))
    log = folder / f"{teacher}-{motion}-{seed}.mcap"
    done = explore(
        robot,
        way.motion(robot, seed=seed),
        seed=seed,
        out=log,
        simulation=simulation,
        config=way.config,
        guidance=Guidance(guide, way.settings, must_reach=not way.drawn),
        overwrite=True,
    )
    return TeacherTrial(
        teacher=teacher,
        motion=motion,
        error_cm=done.teacher_error_cm,
        limit_margin=done.limit_margin,
        joint_speed=done.joint_speed,
        comfort=comfort_cost(robot, log),
        self_distance_cm=done.self_distance_cm,
        step_us=1e6 * statistics.median(guide.took_s),
    )


def comfort_cost(robot: RobotConfig, log: Path) -> float:
    """Return half the squared distance from the comfort posture, in parts of ranges and weighted, mean over ticks."""
    order, span = JointMap(robot.joints), robot.upper - robot.lower
    postures = np.array([order.positions(tick.joints) for tick in join_ticks(LogReader(log))])
    return float(0.5 * (robot.weights * ((postures - robot.comfort) / span) ** 2).sum(axis=1).mean())


class _Timed:
    """A guide whose steps are timed."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide
        self.took_s: list[float] = []

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return self._guide.period_ns

    def observe(self, robot: RobotBackend) -> None:
        """Take in what the robot measures at a tick."""
        self._guide.observe(robot)

    def step(self, q: Floats, targets: Floats) -> Floats:
        """Return the posture to command next."""
        began_s = time.perf_counter()
        posture = self._guide.step(q, targets)
        self.took_s.append(time.perf_counter() - began_s)
        return posture
