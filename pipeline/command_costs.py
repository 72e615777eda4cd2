"""What a command costs: the learned controller answers at once, the teacher approaches step by step."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.controller import Controller
from pipeline.evaluation import WASHOUT_STEPS
from pipeline.kinematics import Kinematics
from pipeline.teacher import Teacher
from pipeline.trials import Trial, robot_of

Floats = NDArray[np.float64]

_REPETITIONS = 7  # the median of them counts


@dataclass(frozen=True)
class CommandCost:
    """How well and at what price a controller answers a target.

    Attributes
    ----------
    name : the controller
    mean_cm : eq. (10) on the motion of the comparison [cm]
    microseconds : time of one step, as called from Python [us]
    steps : how many steps it takes for each target
    """

    name: str
    mean_cm: float
    microseconds: float
    steps: int

    @property
    def iterates(self) -> bool:
        """Whether a target is only approached, and reached after several steps."""
        return self.steps > 1


def command_costs(controller: Controller, trial: Trial, *, period_ns: int) -> tuple[CommandCost, CommandCost]:
    """Compare a learned controller with the teacher on a motion that was recorded.

    Parameters
    ----------
    controller : Controller
        What was learned.
    trial : Trial
        It, tried on the motion, beside the teacher.
    period_ns : int
        How long a target of the motion holds [ns].

    Returns
    -------
    tuple of CommandCost
        The learned controller, then the teacher.
    """
    learner, teacher = controller.learner(), Teacher(Kinematics(robot_of(controller)))
    learner.washout(trial.targets[0], steps=WASHOUT_STEPS)
    posture = [teacher.kinematics.robot.comfort]

    def learned(target: Floats) -> None:
        learner.predict(target)

    def taught(target: Floats) -> None:
        posture[0] = teacher.step(posture[0], target)

    teacher_cm = trial.teacher.mean_cm if trial.teacher else float("nan")
    return (
        CommandCost("learned", trial.errors.mean_cm, _microseconds(learned, trial.targets[:, np.newaxis]), 1),
        CommandCost(
            "teacher",
            teacher_cm,
            _microseconds(taught, trial.targets.reshape(-1, 2, 3)),
            period_ns // teacher.config.period_ns,
        ),
    )


def _microseconds(answer: Callable[[Floats], None], targets: Floats) -> float:
    """Time of one answer [us]: the median over repetitions of the motion."""
    times: list[float] = []
    for _ in range(_REPETITIONS):
        began = time.perf_counter()
        for target in targets:
            answer(target)
        times.append((time.perf_counter() - began) / len(targets) * 1e6)
    return statistics.median(times)
