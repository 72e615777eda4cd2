"""Executors for many runs: processes of this machine, or a Dask cluster, as one `concurrent.futures` executor."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor
from contextlib import contextmanager

from pipeline.training.batch import RunsError
from recorders.errors import ConfigError, WireError
from recorders.files.descriptors import need_descriptors

_DESCRIPTORS = 48  # the logs that are read, and the queues between the processes
_OF_A_WORKER = 4  # its pipes
_RETRIES = 3  # of a run whose Dask worker went away


@contextmanager
def local_processes(workers: int | None = None) -> Iterator[Executor]:
    """Compute in fresh processes of this machine, by default one for each core that it lends us.

    If the block ends by an exception, the processes are stopped with the work that they have.

    Raises
    ------
    ConfigError
        If this process may not open as many files as that takes.
    """
    context = multiprocessing.get_context("spawn")
    count = workers or len(os.sched_getaffinity(0))
    need_descriptors(_DESCRIPTORS + count * _OF_A_WORKER, purpose="a pool of processes")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, mp_context=context, initializer=_leave_signals_to_the_parent) as pool:
        try:
            yield pool
        except BaseException:
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise  # the pool finds itself broken, gives up what it has, and joins its processes


@contextmanager
def dask_cluster(address: str, *, worker_wait_s: float = 30.0) -> Iterator[Executor]:
    """Compute on the workers of a Dask cluster, which see the same files.

    Parameters
    ----------
    address : str
        Of its scheduler, such as `tcp://127.0.0.1:8786`.
    worker_wait_s : float
        How long to wait for a worker while there is none, at the start and later [s]. The work waits too: a worker
        that comes in time goes on with it.

    Raises
    ------
    ConfigError
        If Dask is not installed, or the address is not one.
    WireError
        If no scheduler answers there, or its last worker is gone.
    RunsError
        If every worker that took a run up was killed.
    BrokenExecutor
        If the scheduler goes away; what was computed by then was handed over.
    """
    try:
        from distributed import KilledWorker  # noqa: PLC0415  # an extra

        from pipeline.training.dask import await_worker, cancel_without_workers, connected  # noqa: PLC0415
    except ImportError:
        raise ConfigError("a cluster needs Dask: install reenact with the extra `dask`") from None
    no_worker = WireError(
        f"expected a worker of the Dask scheduler at {address}, found none for {worker_wait_s:g} s: "
        f"start one (dask worker {address}), or leave --scheduler out"
    )
    need_descriptors(_DESCRIPTORS, purpose="a cluster")
    with connected(address) as client:
        if not await_worker(client, worker_wait_s):
            raise no_worker
        pool = client.get_executor(pure=False, retries=_RETRIES)
        with cancel_without_workers(client, pool, worker_wait_s) as given_up:
            try:
                yield pool
            except CancelledError:
                raise no_worker if given_up.is_set() else BrokenExecutor(f"{address} is gone") from None
            except KilledWorker as error:
                tried = error.allowed_failures + 1
                raise RunsError(f"a run killed its Dask worker {tried} times over: is there enough memory?") from error
            finally:
                pool.shutdown(wait=False)


def _leave_signals_to_the_parent() -> None:
    """Let Ctrl-C end the parent alone, which then stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
