"""Runs that a test stops at an event: the first one killed in its midst, or all but the first held until a word."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from pipeline.training.batch import Executors, Outcome, Run
from pipeline.training.trainer import train

Compute: TypeAlias = Callable[[Run], Outcome]


class _Wrapping:
    """An executor that computes each run by another function, which is given the one that it was asked for."""

    def __init__(self, executor: Executor, wrapped: Callable[[Compute, Run], Outcome]) -> None:
        self._executor = executor
        self._wrapped = wrapped

    def submit(self, compute: Compute, run: Run) -> Future[Outcome]:
        return self._executor.submit(self._wrapped, compute, run)


@contextmanager
def killing(executors: Executors, killed: Path) -> Iterator[Any]:
    """Open an executor, of which one process is killed; its number is in the file `killed` from then on."""
    with executors() as executor:
        yield _Wrapping(executor, partial(killed_once, killed))


@contextmanager
def holding(executors: Executors, first: Path, word: Path) -> Iterator[Any]:
    """Open an executor whose first run makes the file `first`, and whose others wait until there is a file `word`."""
    with executors() as executor:
        yield _Wrapping(executor, partial(held, first, word))


def killed_once(killed: Path, compute: Compute, run: Run) -> Outcome:
    """Compute a run; the first process of all that comes here is killed at the end of its run's first cycle."""
    if not _is_first(killed):
        return compute(run)
    train(list(run.logs), schedule=run.schedule, config=run.config, on_cycle=lambda report: _die())
    raise AssertionError("a run has no cycle")


def held(first: Path, word: Path, compute: Compute, run: Run) -> Outcome:
    """Compute a run, once it may."""
    if not _is_first(first):
        while not word.exists():
            time.sleep(0.01)
    return compute(run)


def _is_first(file: Path) -> bool:
    try:
        with file.open("x") as made:
            made.write(str(os.getpid()))
    except FileExistsError:
        return False
    return True


def _die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
