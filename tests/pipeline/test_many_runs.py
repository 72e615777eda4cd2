"""Runs computed here, in local processes and on a Dask cluster have one outcome, also when workers are killed."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from clusters import local_cluster
from episodes import write_episode
from sockets import listening

from pipeline.executors import dask_cluster, local_processes
from pipeline.learner_config import LearnerConfig
from pipeline.many_runs import Outcome, Run, RunsError, compute, compute_all
from recorders.errors import LogError
from replay.schedule import Schedule

SEEDS = 3


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    log = write_episode(tmp_path_factory.mktemp("runs") / "log.mcap", samples=20)
    return [Run((log,), Schedule(epochs=150), LearnerConfig(seed=seed)) for seed in range(SEEDS)]


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


@contextmanager
def killing(victims: Callable[[], list[int]]) -> Iterator[list[int]]:
    """Kill the first worker that shows itself, once it is at work; yields the list of the killed."""
    killed: list[int] = []
    give_up = threading.Event()

    def kill() -> None:
        while not give_up.is_set() and not killed:
            for pid in victims():
                if seconds_computed(pid) > 2.5:  # imports are over by then, the run is not
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)
                    return
            time.sleep(0.05)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield killed
    finally:
        give_up.set()
        thread.join()


def seconds_computed(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children() -> list[int]:
    return [process.pid for process in multiprocessing.active_children() if process.pid is not None]


def test_local_processes(runs: list[Run], expected: list[Outcome]) -> None:
    told: list[int] = []
    assert_same(compute_all(runs, partial(local_processes, 2), on_done=told.append), expected)
    assert told == [1, 2, 3]


def test_local_processes_of_which_one_is_killed(runs: list[Run], expected: list[Outcome]) -> None:
    with killing(children) as killed:
        found = compute_all(runs, partial(local_processes, 2))
    assert len(killed) == 1
    assert_same(found, expected)


def test_a_cluster(runs: list[Run], expected: list[Outcome], cluster: str) -> None:
    told: list[int] = []
    assert_same(compute_all(runs, partial(dask_cluster, cluster), on_done=told.append), expected)
    assert told == [1, 2, 3]
    for pid in (os.getpid(), *children()):
        assert all(address.startswith("tcp 0100007F:") for address in listening(pid))


def test_a_cluster_of_which_a_worker_is_killed(runs: list[Run], expected: list[Outcome], cluster: str) -> None:
    with killing(children) as killed:
        found = compute_all(runs, partial(dask_cluster, cluster))
    assert len(killed) == 1
    assert_same(found, expected)


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
