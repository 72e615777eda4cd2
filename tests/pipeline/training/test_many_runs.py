"""Runs computed here, in local processes and on a Dask cluster have one outcome, also when workers are killed."""

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from clusters import local_cluster
from episodes import write_episode
from run_events import killing
from sockets import listening

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.batch import Outcome, Run, RunsError, compute, compute_all
from pipeline.training.executors import dask_cluster, local_processes
from recorders.errors import LogError
from replay.sources.schedule import Schedule

SEEDS = 3


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    log = write_episode(tmp_path_factory.mktemp("runs") / "log.mcap", samples=20)
    return [Run((log,), Schedule(epochs=10), LearnerConfig(seed=seed)) for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def expected(runs: list[Run]) -> list[Outcome]:
    return [compute(run) for run in runs]


@pytest.fixture
def cluster() -> Iterator[str]:
    with local_cluster() as address:
        yield address


def assert_same(found: list[Outcome], expected: list[Outcome]) -> None:
    for outcome, one in zip(found, expected, strict=True):
        assert (outcome.digest, outcome.stream_digest) == (one.digest, one.stream_digest)
        assert outcome.errors_cm == one.errors_cm
        assert outcome.controller.digest == one.controller.digest
    assert len({outcome.digest for outcome in found}) == len(found)


def children() -> list[int]:
    return [process.pid for process in multiprocessing.active_children() if process.pid is not None]


def test_local_processes(runs: list[Run], expected: list[Outcome]) -> None:
    told: list[int] = []
    assert_same(compute_all(runs, partial(local_processes, 2), on_done=told.append), expected)
    assert told == [1, 2, 3]


def test_local_processes_of_which_one_is_killed(runs: list[Run], expected: list[Outcome], tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    assert_same(compute_all(runs, partial(killing, partial(local_processes, 2), killed)), expected)
    assert int(killed.read_text()) != os.getpid()


def test_a_cluster(runs: list[Run], expected: list[Outcome], cluster: str) -> None:
    told: list[int] = []
    assert_same(compute_all(runs, partial(dask_cluster, cluster), on_done=told.append), expected)
    assert told == [1, 2, 3]
    for pid in (os.getpid(), *children()):
        assert all(address.startswith("tcp 0100007F:") for address in listening(pid))


def test_a_cluster_of_which_a_worker_is_killed(
    runs: list[Run], expected: list[Outcome], cluster: str, tmp_path: Path
) -> None:
    killed = tmp_path / "killed"
    assert_same(compute_all(runs, partial(killing, partial(dask_cluster, cluster), killed)), expected)
    assert int(killed.read_text()) != os.getpid()


def test_a_run_that_fails_ends_all_with_its_own_error(runs: list[Run], tmp_path: Path) -> None:
    missing = Run((tmp_path / "none.mcap",), Schedule(epochs=1), LearnerConfig())
    others = set(children())  # such as what is left of a cluster
    with pytest.raises(LogError, match=r"none\.mcap"):
        compute_all([missing, *runs], partial(local_processes, 2))
    assert set(children()) <= others


def test_executors_that_break_again_and_again_end_with_one_line(runs: list[Run]) -> None:
    opened: list[ThreadPoolExecutor] = []

    def breaking() -> ThreadPoolExecutor:
        opened.append(ThreadPoolExecutor(1, initializer=os.stat, initargs=("",)))
        return opened[-1]

    with pytest.raises(RunsError, match="killed, or their cluster lost, 3 times over: is there enough memory"):
        compute_all(runs, breaking)
    assert len(opened) == 3
