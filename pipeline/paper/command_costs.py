"""Cost of a command: the learned controller answers in one step, the teacher in as many as it is allowed."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import WASHOUT_STEPS, posture_errors
from pipeline.evaluation.trials import Trial, robot_of
from pipeline.learner.controller import Controller
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher

_REPETITIONS = 7  # the median of them counts

_Step = Callable[[Floats], Floats]
"""Takes a target [m], shape (6,), and returns the posture to command (n,)."""


@dataclass(frozen=True)
class CommandCost:
    """Error and cost of a controller's answer to a target, by kinematics alone.

    Attributes
    ----------
    name : str
        The controller.
    mean_cm : float
        Eq. (10) of the postures at the end of each target, on the motion of the comparison [cm].
    microseconds : float
        Time of one step, as called from Python [us].
    steps : int
        How many steps it takes for each target.
    """

    name: str
    mean_cm: float
    microseconds: float
    steps: int


def command_costs(controller: Controller, trial: Trial, *, period_ns: int) -> tuple[CommandCost, ...]:
    """Compare a learned controller with the teacher, for whom the number of steps is a choice.

    What is compared is the posture that each gives for a target, not what a robot makes of it.

    Parameters
    ----------
    controller : Controller
        What was learned.
    trial : Trial
        It, tried on a motion.
    period_ns : int
        How long a target of the motion holds [ns].

    Returns
    -------
    tuple of CommandCost
        The learned controller; the teacher with steps of the exploration's length; the teacher with one step a target.
    """
    kinematics = Kinematics(robot_of(controller))
    short_ns = Teacher(kinematics).config.period_ns
    answer, targets = _learned(controller, trial.targets[0]), trial.targets
    costs = [CommandCost("learned", trial.errors.mean_cm, _microseconds(answer, targets), 1)]
    for step_ns in (short_ns, period_ns):
        steps, taught = period_ns // step_ns, _taught(kinematics, step_ns / 1e9)
        mean_cm = _mean_cm(kinematics, taught, targets, steps)
        costs.append(
            CommandCost(f"teacher, {step_ns / 1e6:g} ms a step", mean_cm, _microseconds(taught, targets), steps)
        )
    return tuple(costs)


def _learned(controller: Controller, first: Floats) -> _Step:
    learner = controller.learner()
    learner.washout(first, steps=WASHOUT_STEPS)
    return lambda target: learner.predict(target[np.newaxis])[0]


def _taught(kinematics: Kinematics, period_s: float) -> _Step:
    teacher, posture = Teacher(kinematics), [kinematics.robot.comfort]

    def step(target: Floats) -> Floats:
        """Return the next posture."""
        posture[0] = teacher.step_for(posture[0], target.reshape(2, 3), period_s)
        return posture[0]

    return step


def _mean_cm(kinematics: Kinematics, step: _Step, targets: Floats, steps: int) -> float:
    """Error [cm] of a step taken so many times for each target, from where the first target brings it."""
    for _ in range(steps):
        step(targets[0])
    postures = np.array([[step(target) for _ in range(steps)][-1] for target in targets])
    return posture_errors(kinematics, postures, targets).mean_cm


def _microseconds(step: _Step, targets: Floats) -> float:
    """Time of one step [us]: the median over repetitions of the motion."""
    times: list[float] = []
    for _ in range(_REPETITIONS):
        began = time.perf_counter()
        for target in targets:
            step(target)
        times.append((time.perf_counter() - began) / len(targets) * 1e6)
    return statistics.median(times)
