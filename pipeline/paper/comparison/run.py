"""Comparison of learning rules: explores, learns and tries."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from itertools import product
from pathlib import Path

from pipeline.learner.controller import Controller
from pipeline.motions.names import PATTERNS, drawings
from pipeline.paper.comparison.error_parts import error_parts
from pipeline.paper.comparison.explorations import (
    EXPLORATIONS,
    OTHER_ROBOTS,
    TAUGHT,
    Exploration,
    Explored,
    explore_and_learn,
)
from pipeline.paper.comparison.results import Comparison
from pipeline.paper.comparison.rules import compare_rules, motions_of, step_costs
from pipeline.robot.config import load_robot
from pipeline.terminal import console
from pipeline.training.batch import RunsError, as_completed
from pipeline.training.executors import local_processes
from recorders.errors import ConfigError

FOLDER = "explorations"
"""Where the logs go, within the folder of a run."""

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
    """

    epochs: int = 150
    explorations: tuple[Exploration, ...] = (*EXPLORATIONS, *OTHER_ROBOTS)
    step_ns: int | None = None

    @classmethod
    def quick(cls, *, step_ns: int) -> "ComparisonConfig":
        """Return a comparison of seconds; its numbers have no meaning."""
        short = tuple(replace(one, duration_s=one.duration_s / 40.0) for one in EXPLORATIONS)
        return cls(2, tuple(replace(one, duration_s=max(1.0, one.duration_s)) for one in short), step_ns)


def compare(
    out: Path, networks: Sequence[Controller], log: Path, *, seeds: Sequence[int], config: ComparisonConfig
) -> Comparison:
    """Explore in all ways and compare the rules.

    Parameters
    ----------
    out : Path
        Folder; the logs go to one within it.
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
    folder = out / FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: expected a folder to write to: {error.strerror}") from error
    known = [one for one in config.explorations if one.robot == TAUGHT.robot or _has_models()]
    explored = _explored(known, seeds, folder, config.step_ns)
    first = config.explorations[0]
    logs = [one.log for one in explored if one.exploration == first]
    robot = load_robot(first.robot)
    motions = motions_of(robot, (*PATTERNS, *drawings()))
    with console.progress("compare rules"):
        rules = tuple(compare_rules(logs, motions, epochs=config.epochs))
        parts = tuple(error_parts(networks, log, logs[0], robot=robot, motions=motions, epochs=config.epochs))
        costs = step_costs(logs[0])
    missing = tuple(one for one in config.explorations if one not in known)
    return Comparison(tuple(seeds), tuple(explored), missing, rules, parts, costs)


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
