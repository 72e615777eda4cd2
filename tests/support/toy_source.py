"""An exploration source as somebody else brings it: both hands go to and fro across, as far as the seed has it."""

from collections.abc import Callable, Iterator

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.source import DrawnMotion
from pipeline.motions.motion import Motion
from pipeline.seeding import uniforms
from pipeline.teacher.teacher import Teacher


def sweep(
    teacher: Teacher,
    *,
    seed: int,
    duration_ns: int,
    tick_ns: int,
    noise: Iterator[Floats] | None,
    progress: Callable[[float], None],
) -> Motion:
    count = duration_ns // tick_ns
    width = 0.02 + 0.02 * uniforms(seed, "toy sweep", count=1)
    across = width * np.abs(np.arange(count) % 8 - 4.0)[:, np.newaxis] / 4.0
    targets = teacher.kinematics.robot.centres + across[:, :, np.newaxis] * np.array([0.0, 1.0, 0.0])
    progress(1.0)
    return Motion("sweep", np.arange(float(count)) * (tick_ns * 1e-9), targets, closed=False)


SOURCE = DrawnMotion("sweep", sweep)
