"""A Dask cluster on loopback, for a test."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def local_cluster() -> Iterator[str]:
    """A cluster of two worker processes on loopback; yields its scheduler's address."""
    from distributed import LocalCluster

    options = {"host": "127.0.0.1", "dashboard_address": None, "worker_dashboard_address": None}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, silence_logs="CRITICAL", **options) as local:
        yield local.scheduler_address
