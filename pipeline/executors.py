"""Where many runs are computed: processes of this machine, or a Dask cluster, as one `concurrent.futures` executor."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from recorders.errors import ConfigError, WireError

_CONNECT_S = 10.0
_RETRIES = 3  # of a run whose Dask worker went away


@contextmanager
def local_processes(workers: int | None = None) -> Iterator[Executor]:
    """Compute in fresh processes of this machine, by default one for each core that it lends us.

    If the block ends by an exception, the processes are stopped with the work that they have.
    """
    context = multiprocessing.get_context("spawn")
    count = workers or len(os.sched_getaffinity(0))
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, mp_context=context, initializer=_leave_signals_to_the_parent) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
                process.join()
            raise


@contextmanager
def dask_cluster(address: str) -> Iterator[Executor]:
    """Compute on the workers of a Dask cluster, which see the same files.

    Parameters
    ----------
    address : str
        Of its scheduler, such as `tcp://127.0.0.1:8786`.

    Raises
    ------
    ConfigError
        If Dask is not installed, or the address is not one.
    WireError
        If no scheduler answers there.
    """
    try:
        from distributed import Client  # noqa: PLC0415  # an extra
    except ImportError:
        raise ConfigError("a cluster needs Dask: install reenact with the extra `dask`") from None
    try:
        client: Any = Client(address, timeout=_CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise WireError(f"no Dask scheduler answers at {address}: start one, or leave --scheduler out") from error
    except ValueError as error:
        raise ConfigError(f"expected the address of a Dask scheduler, such as tcp://127.0.0.1:8786: {error}") from error
    with client:
        pool = client.get_executor(pure=False, retries=_RETRIES)
        try:
            yield pool
        finally:
            pool.shutdown(wait=False)


def _leave_signals_to_the_parent() -> None:
    """Let Ctrl-C end the parent alone, which then stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
