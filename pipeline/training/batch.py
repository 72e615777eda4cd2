"""Many trainings of the same kind, such as the paper's ten initialisations; where they are computed changes no bit."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pipeline.learner.controller import Controller
from pipeline.learner.rule import Settings
from pipeline.training.trainer import train
from recorders.errors import ReenactError
from replay.sources.schedule import Schedule

_ATTEMPTS = 3
_LOOK_S = 0.5  # longest single wait
_Result = TypeVar("_Result")

Executors = Callable[[], AbstractContextManager[Executor]]
"""Opens an executor: `pipeline.training.executors.local_processes`, or a cluster."""


class RunsError(ReenactError):
    """Runs could not be computed, whatever was tried."""


@dataclass(frozen=True)
class Run:
    """One training that is to be computed.

    Parameters
    ----------
    logs : tuple of Path
        What to learn from.
    schedule : Schedule
        How often.
    config : Settings
        The learner, with the seed that makes this run another one.
    """

    logs: tuple[Path, ...]
    schedule: Schedule
    config: Settings


@dataclass(frozen=True)
class Outcome:
    """The result of a run.

    Attributes
    ----------
    digest, stream_digest : str
        State and stream digest at its end.
    errors_cm : tuple of float
        Eq. (10) of every epoch [cm].
    controller : Controller
        What was learned.
    """

    digest: str
    stream_digest: str
    errors_cm: tuple[float, ...]
    controller: Controller


def compute(run: Run) -> Outcome:
    """Compute one run, here and now; raises ReenactError as training does."""
    trainer = train(list(run.logs), schedule=run.schedule, config=run.config)
    result = trainer.result()
    return Outcome(result["digest"], result["stream_digest"], tuple(trainer.errors_cm), trainer.controller())


def compute_all(
    runs: Sequence[Run], executors: Executors, *, on_done: Callable[[int], None] = lambda done: None
) -> list[Outcome]:
    """Compute many runs and return their outcomes in the order of the runs, whichever is finished first.

    Runs whose process was killed, or whose cluster was lost, are computed again on a new executor; those that were
    finished are kept.

    Parameters
    ----------
    runs : sequence of Run
    executors : callable
        Opens the executor to compute them on.
    on_done : callable
        Called with the number of finished runs after each.

    Raises
    ------
    ReenactError
        If a run fails, or its processes are killed or its cluster is lost again and again.
    """
    outcomes: dict[int, Outcome] = {}
    for _ in range(_ATTEMPTS):
        try:
            with executors() as executor:
                for index, outcome in _computed(executor, runs, outcomes):
                    outcomes[index] = outcome
                    on_done(len(outcomes))
            return [outcomes[index] for index in range(len(runs))]
        except BrokenExecutor:
            continue
    raise RunsError(
        f"worker processes were killed, or their cluster lost, {_ATTEMPTS} times over: is there enough memory?"
    )


def _computed(executor: Executor, runs: Sequence[Run], known: dict[int, Outcome]) -> Iterator[tuple[int, Outcome]]:
    """Yield the outcomes that are not known yet, as they come."""
    waiting: dict[Future[Outcome], int] = {}
    for index, run in enumerate(runs):
        if index not in known:
            waiting[executor.submit(compute, run)] = index
    for future in as_completed(waiting):
        yield waiting[future], future.result()


def as_completed(futures: Iterable[Future[_Result]]) -> Iterator[Future[_Result]]:
    """Yield futures as they end. It never waits for long: a signal that comes just before a wait does not end it."""
    waiting = set(futures)
    while waiting:
        ended, waiting = wait(waiting, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
        yield from ended
