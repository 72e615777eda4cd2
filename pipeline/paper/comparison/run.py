"""Comparison of learning rules: explores, learns and tries."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from itertools import product
from pathlib import Path

from pipeline.exploration.leader import TEACHERS
from pipeline.exploration.via_points import VOLUME
from pipeline.learner.controller import Controller
from pipeline.motions.names import PATTERNS, drawings
from pipeline.paper.comparison.error_parts import ErrorPart, error_parts
from pipeline.paper.comparison.explorations import (
    EXPLORATIONS,
    OTHER_ROBOTS,
    TAUGHT,
    Exploration,
    Explored,
    explore_and_learn,
)
from pipeline.paper.comparison.goal_babbling import goal_babbling
from pipeline.paper.comparison.results import Babbled, Comparison
from pipeline.paper.comparison.rules import ComparedRule, Motions, compare_rules, errors_of, motions_of, step_costs
from pipeline.paper.comparison.teachers import TAUGHT_MOTIONS, TeacherTrial, try_teacher
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.terminal import console
from pipeline.training.batch import RunsError, as_completed
from pipeline.training.executors import local_processes
from recorders.errors import ConfigError

FOLDER, TEACHERS_FOLDER = "explorations", "teachers"
"""Where the logs go, within the folder of a run: those that rules learn from, and those of both teachers."""

_MODELS = "example-robot-data"


@dataclass(frozen=True)
class ComparisonConfig:
    """Extent of a comparison.

    Attributes
    ----------
    epochs : int
        Epochs of the paper's rule.
    explorations : tuple of Exploration
        What is explored; the first of them is what all rules learn from.
    step_ns : int or None
        Period of teacher and simulation [ns] of a coarse run.
    taught_motions : mapping of str to float or None
        Motions that both teachers follow, with the length [s] of one that is drawn.
    """

    epochs: int = 150
    explorations: tuple[Exploration, ...] = (*EXPLORATIONS, *OTHER_ROBOTS)
    step_ns: int | None = None
    taught_motions: Mapping[str, float | None] = field(default_factory=lambda: TAUGHT_MOTIONS)

    @classmethod
    def quick(cls, *, step_ns: int) -> "ComparisonConfig":
        """Return a comparison of seconds; its numbers have no meaning."""
        short = tuple(replace(one, duration_s=one.duration_s / 40.0) for one in EXPLORATIONS)
        return cls(2, tuple(replace(one, duration_s=max(1.0, one.duration_s)) for one in short), step_ns, {VOLUME: 1.0})


def compare(
    out: Path, networks: Sequence[Controller], log: Path, *, seeds: Sequence[int], config: ComparisonConfig
) -> Comparison:
    """Explore in all ways and compare the rules.

    Parameters
    ----------
    out : Path
        Folder; the logs go to two within it.
    networks, log : sequence of Controller and Path
        Networks of the paper's rule, and what they learned from.
    seeds : sequence of int
        Seeds of the explorations.
    config : ComparisonConfig
        How much of it.

    Raises
    ------
    ReenactError
        If a stage fails.
    """
    folder = _folder(out / FOLDER)
    known = [one for one in config.explorations if one.robot == TAUGHT.robot or _has_models()]
    explored = _explored(known, seeds, folder, config.step_ns)
    first = config.explorations[0]
    logs = [one.log for one in explored if one.exploration == first and not one.refused]
    robot = load_robot(first.robot)
    motions = motions_of(robot, (*PATTERNS, *drawings()))
    return Comparison(
        seeds=tuple(seeds),
        explored=tuple(explored),
        missing=tuple(one for one in config.explorations if one not in known),
        rules=tuple(_rules(logs, motions, config.epochs)),
        parts=tuple(_parts(networks, log, logs, robot, motions, config.epochs)),
        costs=step_costs(logs[0]) if logs else None,
        babbled=tuple(_babbled([one for one in known if not one.is_taught], seeds, robot, motions)),
        teachers=tuple(_teachers(config, seeds[0], _folder(out / TEACHERS_FOLDER))),
    )


def _folder(folder: Path) -> Path:
    """Make a folder, unless it is there, and return it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: expected a folder to write to: {error.strerror}") from error
    return folder


def _rules(logs: Sequence[Path], motions: Motions, epochs: int) -> Iterator[ComparedRule]:
    """Let all rules learn from explorations; none if there are none."""
    if logs:
        with console.progress("compare rules"):
            yield from compare_rules(logs, motions, epochs=epochs)


def _parts(
    networks: Sequence[Controller],
    log: Path,
    volume_logs: Sequence[Path],
    robot: RobotConfig,
    motions: Motions,
    epochs: int,
) -> Iterator[ErrorPart]:
    """Take the error of networks apart, with the first of some explorations; not at all if there is none."""
    if volume_logs:
        with console.progress("take the error apart"):
            yield from error_parts(networks, log, volume_logs[0], robot=robot, motions=motions, epochs=epochs)


def _babbled(
    explorations: Iterable[Exploration], seeds: Iterable[int], robot: RobotConfig, motions: Motions
) -> Iterator[Babbled]:
    """Let goal babbling learn for as long as each exploration, from each seed."""
    with console.progress("babble goals"):
        for one in explorations:
            answers = [goal_babbling(robot, seed=seed, duration_s=one.duration_s) for seed in seeds]
            yield Babbled(one, tuple(errors_of(robot, answer, motions) for answer in answers))


def _teachers(config: ComparisonConfig, seed: int, folder: Path) -> Iterator[TeacherTrial]:
    """Let both teachers follow motions, one after the other, for their times."""
    trials = list(product(config.taught_motions.items(), TEACHERS))
    with console.progress("compare teachers") as advance:
        for done, ((motion, duration_s), teacher) in enumerate(trials, 1):
            yield try_teacher(
                teacher,
                motion,
                robot_name=TAUGHT.robot,
                seed=seed,
                folder=folder,
                duration_s=duration_s,
                step_ns=config.step_ns,
            )
            advance(done / len(trials))


def _explored(
    explorations: Sequence[Exploration], seeds: Sequence[int], folder: Path, step_ns: int | None
) -> list[Explored]:
    """Explore the first with nothing beside it, for its time, and all others side by side; in a fixed order."""
    work = partial(explore_and_learn, folder=folder, step_ns=step_ns)
    (exploration, seed), *others = product(explorations, seeds)
    with console.progress("explore for a rule"):
        explored = [work(exploration, seed=seed)]
    with console.progress("explore in other ways") as advance, local_processes() as pool:
        return explored + _side_by_side(pool, work, others, advance)


def _side_by_side(
    pool: Executor,
    work: Callable[..., Explored],
    others: Iterable[tuple[Exploration, int]],
    advance: Callable[[float], None],
) -> list[Explored]:
    futures = [pool.submit(work, exploration, seed=seed) for exploration, seed in others]
    try:
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            advance(done / len(futures))
    except BrokenProcessPool as error:
        raise RunsError("a process that explores was killed: is there enough memory?") from error
    return [future.result() for future in futures]


def _has_models() -> bool:
    """Whether the models of the other robots are installed: a distribution of data, with no module."""
    try:
        distribution(_MODELS)
    except PackageNotFoundError:
        return False
    return True
