"""Rules and baselines that learn from the same exploration, each with its errors and what it costs."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import WASHOUT_STEPS, HandErrors, posture_errors
from pipeline.learner.body import body_of
from pipeline.learner.controller import Controller
from pipeline.learner.registry import default_config, make_learner
from pipeline.learner.rule import OnlineLearner
from pipeline.motions.motion import load_motion
from pipeline.paper.comparison.echo_state import echo_state
from pipeline.paper.comparison.explorations import RULE
from pipeline.paper.comparison.regressions import (
    Answer,
    Fit,
    kernel_ridge,
    library_kernel_ridge,
    library_perceptron,
    polynomial_ridge,
)
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairs import Samples, read_samples
from pipeline.training.trainer import train
from replay.sources.schedule import Schedule

REACHED = "reached"
PAPERS_RULE, OUR_RULE = "the paper's rule", "forward-inverse"
NOT_COMPARED = "not compared: install compare"
_LIBRARY = "sklearn"
_REPETITIONS = 5  # the median of them counts
_US_PER_S = 1e6

BASELINES: Mapping[str, Fit] = {
    "linear ridge": polynomial_ridge(1),
    "cubic ridge": polynomial_ridge(3),
    "quartic ridge": polynomial_ridge(4),
    "kernel ridge": kernel_ridge,
    "reservoir with an RLS readout": echo_state,
    "scikit-learn's kernel ridge": library_kernel_ridge,
    "scikit-learn's MLP": library_perceptron,
}

Motions = Mapping[str, Floats]
"""Targets [m], shape (T, 3 hands), by the name of the motion."""


@dataclass(frozen=True)
class ComparedRule:
    """A rule or baseline after the same explorations as all others.

    Attributes
    ----------
    name : str
        Its name.
    errors : tuple of mapping of str to HandErrors
        For each exploration, by motion; empty if it is not installed.
    tick_us, command_us : float
        Time of learning, for each tick, and of one command as called from Python [us]; median over the explorations.
    """

    name: str
    errors: tuple[Mapping[str, HandErrors], ...]
    tick_us: float = 0.0
    command_us: float = 0.0


@dataclass(frozen=True)
class StepCosts:
    """Times of compiled steps [us], many in one call.

    Attributes
    ----------
    learning_us, command_us : float
        The rule forward-inverse: a step that learns, and a command.
    papers_us : float
        The paper's rule: a step that learns.
    """

    learning_us: float
    command_us: float
    papers_us: float


@dataclass(frozen=True)
class _Learned:
    """Result of one fit: what it answers [rad or m] to targets [m], and the time of learning for each tick [us]."""

    answer: Answer
    tick_us: float


def motions_of(robot: RobotConfig, names: Sequence[str]) -> dict[str, Floats]:
    """Return the targets of motions known by name."""
    loaded = {name: load_motion(name, robot) for name in names}
    return {name: motion.targets.reshape(len(motion), -1) for name, motion in loaded.items()}


def compare_rules(logs: Sequence[Path], motions: Motions, *, epochs: int) -> Iterator[ComparedRule]:
    """Let every rule learn from each of some logs; yield what became of it.

    Parameters
    ----------
    logs : sequence of Path
        Explorations of one robot.
    motions : mapping of str to ndarray
        What each is tried on.
    epochs : int
        Epochs of the paper's rule, which needs many; all others learn in one pass.
    """
    samples = [read_samples(log, pairs=REACHED) for log in logs]
    yield _compared(PAPERS_RULE, [partial(_papers, log, epochs) for log in logs], samples, motions)
    for name, fit in BASELINES.items():
        fits = [partial(_fitted, fit, part, seed) for seed, part in enumerate(samples)]
        try:
            yield _compared(name, fits, samples, motions)
        except ModuleNotFoundError as error:
            if error.name is None or error.name.partition(".")[0] != _LIBRARY:
                raise
            yield ComparedRule(name, ())
    yield _compared(
        OUR_RULE, [partial(_ours, log, part) for log, part in zip(logs, samples, strict=True)], samples, motions
    )


def step_costs(log: Path) -> StepCosts:
    """Measure the compiled steps of both rules on the samples of a log."""
    samples = read_samples(log, pairs=REACHED)
    ours, papers = _new_learner(samples, RULE), _new_learner(samples, None)
    papers.begin_epoch(0)
    u, d = samples.targets, _taught(samples)
    learning_us = _per_row_us(lambda: ours.step(u, d, learning=True), len(u))
    command_us = _per_row_us(lambda: ours.predict(u), len(u))
    return StepCosts(learning_us, command_us, _per_row_us(lambda: papers.step(u, d, learning=True), len(u)))


def errors_of(robot: RobotConfig, answer: Answer, motions: Motions) -> dict[str, HandErrors]:
    """Try what answers joints [rad or m] to targets [m] on motions; the first target of each is held before.

    Raises
    ------
    ConfigError
        The errors are no finite numbers.
    """
    kinematics, errors = Kinematics(robot), {}
    for name, targets in motions.items():
        joints = answer(np.concatenate([np.repeat(targets[:1], WASHOUT_STEPS, axis=0), targets]))[WASHOUT_STEPS:]
        errors[name] = posture_errors(kinematics, joints, targets)
    return errors


def answer_of(controller: Controller, *, hold: int = 1) -> Answer:
    """Return the answers of a controller to targets, each of them held for so many ticks."""
    learner, joints = controller.learner(), len(controller.joints)

    def answer(u: Floats) -> Floats:
        """Return the joints (T, n) at the end of each target's hold."""
        return learner.predict(np.repeat(u, hold, axis=0))[hold - 1 :: hold, -joints:]

    return answer


def _compared(
    name: str, fits: Sequence[Callable[[], _Learned]], samples: Sequence[Samples], motions: Motions
) -> ComparedRule:
    learned = [fit() for fit in fits]
    errors = tuple(errors_of(part.robot, one.answer, motions) for one, part in zip(learned, samples, strict=True))
    targets = next(iter(motions.values()))
    command_us = median(_command_us(one.answer, targets) for one in learned)
    return ComparedRule(name, errors, median(one.tick_us for one in learned), command_us)


def _fitted(fit: Fit, samples: Samples, seed: int) -> _Learned:
    """Fit a baseline to scaled samples."""
    robot = samples.robot
    centre, reach = robot.input_centre, np.array(body_of(robot).reach)
    half = (robot.upper - robot.lower) / 2.0
    targets, joints = (samples.targets - centre) / reach, (samples.joints - robot.comfort) / half
    began_s = time.perf_counter()
    answer = fit(targets, joints, seed)
    tick_us = (time.perf_counter() - began_s) / len(targets) * _US_PER_S
    return _Learned(lambda u: robot.comfort + half * answer((u - centre) / reach), tick_us)


def _papers(log: Path, epochs: int) -> _Learned:
    began_s = time.perf_counter()
    trainer = train([log], schedule=Schedule(epochs=epochs), config=default_config(), pairs=REACHED)
    ticks = len(read_samples(log, pairs=REACHED).targets)
    return _Learned(answer_of(trainer.controller()), (time.perf_counter() - began_s) / ticks * _US_PER_S)


def _ours(log: Path, samples: Samples) -> _Learned:
    settings = default_config(RULE)
    controller = train([log], schedule=settings.schedule(), config=settings).controller()
    learner, u, d = _new_learner(samples, RULE), samples.targets, _taught(samples)
    return _Learned(answer_of(controller), _per_row_us(lambda: learner.step(u, d, learning=True), len(u)))


def _new_learner(samples: Samples, rule: str | None) -> OnlineLearner:
    robot = samples.robot
    settings = default_config(rule).with_body(body_of(robot))
    output_centre = np.concatenate([robot.input_centre, robot.comfort])
    return make_learner(settings, input_centre=robot.input_centre, output_centre=output_centre)


def _taught(samples: Samples) -> Floats:
    return np.concatenate([samples.targets, samples.joints], axis=1)


def _command_us(answer: Answer, targets: Floats) -> float:
    """Time of a command [us], a target in each call."""

    def command_all() -> None:
        """Answer every target."""
        for target in targets:
            answer(target[np.newaxis])

    return _per_row_us(command_all, len(targets))


def _per_row_us(work: Callable[[], object], rows: int) -> float:
    """Time of some work on rows, for each of them [us]: the median over repetitions, after one to warm up."""
    work()
    times: list[float] = []
    for _ in range(_REPETITIONS):
        began_s = time.perf_counter()
        work()
        times.append(time.perf_counter() - began_s)
    return median(times) / rows * _US_PER_S
