"""Runs of which the first one that is taken up is killed in its midst, with the process that computes it."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.many_runs import Executors, Outcome, Run
from pipeline.training import train


class _Killing:
    """An executor whose processes compute each run as they are asked to, but for the first."""

    def __init__(self, executor: Executor, killed: Path) -> None:
        self._executor = executor
        self._killed = killed

    def submit(self, compute: Any, run: Run) -> Future[Outcome]:
        return self._executor.submit(killed_once, self._killed, compute, run)


@contextmanager
def killing(executors: Executors, killed: Path) -> Iterator[_Killing]:
    """Open an executor, of which one process is killed; its number is in the file `killed` from then on."""
    with executors() as executor:
        yield _Killing(executor, killed)


def killed_once(killed: Path, compute: Any, run: Run) -> Outcome:
    """Compute a run; the first process of all that comes here is killed at the end of its run's first cycle."""
    try:
        with killed.open("x") as file:
            file.write(str(os.getpid()))
    except FileExistsError:
        return compute(run)
    train(list(run.logs), schedule=run.schedule, config=run.config, on_cycle=lambda report: _die())
    raise AssertionError("a run has no cycle")


def _die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
