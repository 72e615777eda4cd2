"""A Dask cluster that is not there, or is lost half-way: one line in bounded time, and what can be kept is kept."""

import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cluster_user
import dask
import distributed  # noqa: F401  # loads its settings: one that is set before would take all of them away at its end
import pytest
from clusters import BareCluster, bare_cluster, local_cluster
from episodes import write_episode
from processes import complaint, reenact
from proxy import Proxy

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.batch import Run, RunsError, compute, compute_all
from pipeline.training.executors import dask_cluster
from recorders.errors import ConfigError, WireError
from recorders.wire.loopback import free_endpoint
from replay.sources.schedule import Schedule

EPOCHS, COUNT = 60, 3
WORKER_S = 120.0
END_S = 240.0  # far more than any of it takes, and far less than for ever


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("runs") / "log.mcap", samples=20)


@pytest.fixture(scope="module")
def runs(log: Path) -> list[Run]:
    return [Run((log,), Schedule(epochs=EPOCHS), LearnerConfig(seed=seed)) for seed in range(COUNT)]


@pytest.fixture(scope="module")
def digests(runs: list[Run]) -> list[str]:
    return [compute(run).digest for run in runs]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[BareCluster]:
    with bare_cluster(tmp_path, workers=1) as started:
        with dask_cluster(started.address, worker_wait_s=WORKER_S):
            pass  # its worker is there
        yield started


@pytest.fixture
def silent_port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


def user(address: str, log: Path, *, wait_s: float = WORKER_S) -> "subprocess.Popen[str]":
    """Start one; its first run is computed, the others are under way until they are let go on."""
    for word in ("begun", "go on"):
        log.with_name(word).unlink(missing_ok=True)
    arguments = (cluster_user.__file__, address, str(wait_s), str(log), str(COUNT), str(EPOCHS))
    return subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=log.parent
    )


def end_of(process: "subprocess.Popen[str]") -> tuple[str, str]:
    try:
        return process.communicate(timeout=END_S)
    finally:
        process.kill()


def complaint_of(process: "subprocess.Popen[str]") -> str:
    said, complained = end_of(process)
    return complaint(subprocess.CompletedProcess(process.args, process.returncode, said, complained))


def after_one_run(process: "subprocess.Popen[str]") -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "done 1\n"


def test_a_malformed_address_is_one_line_of_a_process(tmp_path: Path) -> None:
    run = reenact("paper", "--quick", "--scheduler", "tcp://127.0.0.1", cwd=tmp_path, timeout_s=END_S)
    assert "expected the address of a Dask scheduler, such as tcp://127.0.0.1:8786, found" in complaint(run)


def test_a_port_where_nothing_listens_is_one_line_of_a_process(log: Path) -> None:
    address = free_endpoint().replace("tcp/", "tcp://")
    expected = f"no Dask scheduler answers at {address} (Connection refused): start one, or leave --scheduler out"
    assert expected in complaint_of(user(address, log))


@pytest.mark.parametrize(
    "address",
    [
        *("nonsense", "", "127.0.0.1:8786", "http://127.0.0.1:1", "tcp://:8786", "tcp://[::1", "tcp://127.0.0.1:0"),
        *("tcp://127.0.0.1:99999", "tcp://127.0.0.1:1/", "tcp://127.0.0.1:1\n", "tcp://host:port"),
    ],
)
def test_an_address_has_a_scheme_a_host_and_a_port(address: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"found {address!r}: it has a scheme")), dask_cluster(address):
        pass


def test_tls_that_is_not_configured_is_one_line(silent_port: int) -> None:
    expected = r"no Dask scheduler answers at tls://.* \(TLS expects a"
    with pytest.raises(WireError, match=expected), dask_cluster(f"tls://127.0.0.1:{silent_port}"):
        pass


def test_a_listener_that_says_nothing_is_no_scheduler(silent_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.training.dask._CONNECT_S", 0.5)
    expected = r"no Dask scheduler answers at .* \(no answer in 0\.5 s\)"
    with pytest.raises(WireError, match=expected), dask_cluster(f"tcp://127.0.0.1:{silent_port}"):
        pass


def test_a_scheduler_without_workers_is_not_waited_for_for_ever(tmp_path: Path) -> None:
    with bare_cluster(tmp_path, workers=0) as cluster:
        expected = f"expected a worker of the Dask scheduler at {cluster.address}, found none for 0.2 s: start one"
        with pytest.raises(WireError, match=expected), dask_cluster(cluster.address, worker_wait_s=0.2):
            pass


def test_a_scheduler_killed_in_mid_run_is_one_line_of_a_process(cluster: BareCluster, log: Path) -> None:
    process = user(cluster.address, log)
    after_one_run(process)
    cluster.scheduler.kill()
    assert "no Dask scheduler answers" in complaint_of(process)


def test_workers_killed_in_mid_run_are_one_line_of_a_process(cluster: BareCluster, log: Path) -> None:
    process = user(cluster.address, log, wait_s=2.0)
    after_one_run(process)
    cluster.kill_workers()
    assert "expected a worker of the Dask scheduler" in complaint_of(process)


def test_a_worker_that_comes_in_time_goes_on(cluster: BareCluster, runs: list[Run], digests: list[str]) -> None:
    told: list[int] = []

    def replace_worker(done: int) -> None:
        told.append(done)
        if done == 1:
            cluster.kill_workers()
            cluster.add_worker()

    outcomes = compute_all(runs, partial(dask_cluster, cluster.address, worker_wait_s=WORKER_S), on_done=replace_worker)
    assert [outcome.digest for outcome in outcomes] == digests
    assert told == [1, 2, 3]


def test_a_cut_connection_costs_no_finished_run(cluster: BareCluster, log: Path, digests: list[str]) -> None:
    with Proxy(cluster.address.replace("tcp://", "tcp/")) as proxy:
        process = user(proxy.endpoint.replace("tcp/", "tcp://"), log)
        after_one_run(process)
        proxy.cut()
        proxy.restore()
        (log.parent / "go on").touch()
        said, complained = end_of(process)
    assert said.split() == ["done", "2", "done", "3", *digests]
    assert complained == ""


def test_a_run_that_kills_its_workers_is_not_tried_for_ever() -> None:
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), local_cluster(1) as address:
        with pytest.raises(RunsError, match="a run killed its Dask worker 2 times over: is there enough memory"):
            with dask_cluster(address) as pool:
                pool.submit(os._exit, 1).result()
