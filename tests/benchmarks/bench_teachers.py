"""The two teachers side by side on the simulated robot: python tests/benchmarks/bench_teachers.py [SECONDS].

Both explore the circles, a drawing and random points in the hands' boxes (SECONDS of it, 20 by default), in Drake, with
the settings of `explore`. Error: of the hands at the end of each target's hold. Margin: smallest distance of a joint
from a limit, in parts of its range. Speed: largest of a joint, in parts of its limit. Comfort: mean cost of leaving the
comfort posture. Distance: smallest between the robot's own parts. Time: of one step of 5 ms, the median. Nothing is
asserted.
"""

import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.episode import Guide
from pipeline.exploration.explore import explore
from pipeline.exploration.leader import TEACHERS
from pipeline.exploration.source import Source, source
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig, load_robot
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import JointMap, join_ticks


class Timed:
    """A guide whose steps are timed."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide
        self.took_s: list[float] = []

    @property
    def period_ns(self) -> int:
        return self._guide.period_ns

    def observe(self, robot: RobotBackend) -> None:
        self._guide.observe(robot)

    def step(self, q: Floats, targets: Floats) -> Floats:
        began = time.perf_counter()
        posture = self._guide.step(q, targets)
        self.took_s.append(time.perf_counter() - began)
        return posture


def comfort_cost(robot: RobotConfig, log: Path) -> float:
    """Squared distance from the comfort posture, in parts of each joint's range and weighted, mean over ticks."""
    order, span = JointMap(robot.joints), robot.upper - robot.lower
    postures = np.array([order.positions(tick.joints) for tick in join_ticks(LogReader(log))])
    return float(0.5 * (robot.weights * ((postures - robot.comfort) / span) ** 2).sum(axis=1).mean())


def row(robot: RobotConfig, wanted: Source, out: Path) -> str:
    guidance = wanted.guidance(robot, seed=0)
    assert guidance.guide is not None
    guide, motion = Timed(guidance.guide), wanted.motion(robot, seed=0)
    timed = replace(guidance, guide=guide, keep_clear=False)  # how near they come is what is shown
    done = explore(robot, motion, seed=0, out=out, guidance=timed, config=wanted.config, overwrite=True)
    near = "none" if done.self_distance_cm is None else f"{done.self_distance_cm:.2f}"
    us = 1e6 * statistics.median(guide.took_s)
    return (
        f"{done.teacher_error_cm:10.3f}{done.limit_margin:9.3f}{done.joint_speed:8.2f}"
        f"{comfort_cost(robot, out):10.4f}{near:>13s}{us:8.0f}"
    )


def main() -> None:
    robot, seconds = load_robot("asimo"), float(sys.argv[1]) if sys.argv[1:] else 20.0
    print(f"{'':28s}{'error cm':>10s}{'margin':>9s}{'speed':>8s}{'comfort':>10s}{'distance cm':>13s}{'us':>8s}")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("circles", "right_hand_drawing", "volume"):
            for teacher in TEACHERS:
                wanted = source(name, teacher=teacher, duration_s=seconds if name == "volume" else None)
                print(f"{name:20s}{teacher:8s}{row(robot, wanted, Path(folder) / 'log.mcap')}", flush=True)


if __name__ == "__main__":
    main()
