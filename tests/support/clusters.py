"""Dask clusters on loopback, for a test."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorders.wire.loopback import free_endpoint

_START_S = 120.0


@contextmanager
def local_cluster(workers: int = 2) -> Iterator[str]:
    """A cluster of worker processes on loopback, each restarted when it ends; yields its scheduler's address."""
    from distributed import LocalCluster

    # Any port for its status: without one, Dask takes a fixed one, which other tests may have.
    options = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "worker_dashboard_address": None}
    with LocalCluster(  # type: ignore[no-untyped-call]
        workers, threads_per_worker=1, processes=True, silence_logs="CRITICAL", **options
    ) as local:
        yield local.scheduler_address


class BareCluster:
    """A scheduler and workers in processes of their own, as a user starts them; nobody restarts what is killed."""

    def __init__(self, folder: Path) -> None:
        self.address = free_endpoint().replace("tcp/", "tcp://")
        self._folder = folder
        host, port = self.address.removeprefix("tcp://").split(":")
        self.scheduler = self._start("dask_scheduler", "--host", host, "--port", port)
        self._workers: list[subprocess.Popen[bytes]] = []
        deadline_s = time.monotonic() + _START_S
        while not _listens(host, int(port)):
            assert time.monotonic() < deadline_s, "the scheduler does not start"
            time.sleep(0.05)

    def add_worker(self) -> None:
        options = ("--no-nanny", "--nthreads", "1", "--local-directory", str(self._folder))
        self._workers.append(self._start("dask_worker", self.address, "--host", "127.0.0.1", *options))

    def kill_workers(self) -> None:
        _kill(self._workers)

    def kill(self) -> None:
        _kill([self.scheduler, *self._workers])

    def _start(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *arguments]
        quiet = subprocess.DEVNULL
        known = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}  # the tests' own runs are found there
        return subprocess.Popen(command, cwd=self._folder, env=known, stdin=quiet, stdout=quiet, stderr=quiet)


@contextmanager
def bare_cluster(folder: Path, *, workers: int) -> Iterator[BareCluster]:
    """A scheduler, with so many workers on their way."""
    cluster = BareCluster(folder)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        cluster.kill()


def _kill(processes: list[subprocess.Popen[bytes]]) -> None:
    for process in processes:
        process.kill()
        process.wait()


def _listens(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True
