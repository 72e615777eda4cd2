"""A connection to a Dask cluster that ends, with one line, where Dask's own would wait for ever or write tracebacks."""

import asyncio
import logging
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from distributed import Client, Security, rpc
from distributed.utils import silence_logging_cmgr

from recorders.errors import ConfigError, WireError
from recorders.threads import background_thread

_CONNECT_S = 10.0  # a busy scheduler answers within seconds
_LOOK_S = 0.5  # between two looks at the workers
_SCHEMES = ("tcp", "tls")


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Yield a client of the scheduler at `address`, and keep Dask's loggers silent for as long.

    Raises
    ------
    ConfigError
        If the address is not one.
    WireError
        If no scheduler answers there.
    """
    host, port = _host_and_port(address)
    with silence_logging_cmgr(logging.CRITICAL + 1):
        try:
            _ask(address, host, port)
            client: Any = Client(address, timeout=_CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
        except Exception as error:  # whoever listens there may answer anything at all
            reason = getattr(error, "strerror", None) or str(error) or f"no answer in {_CONNECT_S:g} s"
            raise WireError(
                f"no Dask scheduler answers at {address} ({reason}): start one, or leave --scheduler out"
            ) from error
        with client:
            yield client


def has_worker(client: Any) -> bool:
    """Return whether the cluster has a worker; one whose scheduler does not answer has none."""
    try:
        return bool(client.sync(client.scheduler.ncores, callback_timeout=_CONNECT_S))
    except (OSError, RuntimeError, AttributeError):  # lost; closing; closed, when a client has no scheduler any more
        return False


def await_worker(client: Any, wait_s: float) -> bool:
    """Wait `wait_s` for a worker, and return whether there is one."""
    deadline_s = time.monotonic() + wait_s
    while not has_worker(client):
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_LOOK_S)
    return True


@contextmanager
def cancel_without_workers(client: Any, pool: Executor, wait_s: float) -> Iterator[threading.Event]:
    """Cancel the work of `pool` when the cluster has had no worker for `wait_s`; yields what is set then."""
    given_up, is_over = threading.Event(), threading.Event()

    def watch() -> None:
        seen_s = time.monotonic()
        while not is_over.wait(_LOOK_S):
            if has_worker(client):
                seen_s = time.monotonic()
            elif time.monotonic() - seen_s > wait_s:
                given_up.set()
                pool.shutdown(wait=False)
                return

    with background_thread(watch, name="workers", stop=is_over.set):
        yield given_up


def _host_and_port(address: str) -> tuple[str, int]:
    """Take an address apart; Dask's client would find it wrong too late to end quietly."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.scheme not in _SCHEMES or address != f"{parts.scheme}://{parts.netloc}":
        raise ConfigError(
            f"expected the address of a Dask scheduler, such as tcp://127.0.0.1:8786, found {address!r}: "
            "it has a scheme (tcp or tls), a host and a port"
        )
    return host, port


def _ask(address: str, host: str, port: int) -> None:
    """Ask who listens at the address, as a client that does not get through leaves a loop behind that hangs.

    Dask tries a refused connection again and again; a plain one fails at once.
    """
    socket.create_connection((host, port), timeout=_CONNECT_S).close()
    kind = asyncio.run(asyncio.wait_for(_identity(address), _CONNECT_S))["type"]
    if kind != "Scheduler":
        raise WireError(f"it is a {kind}")


async def _identity(address: str) -> dict[str, Any]:
    security: Any = Security()  # type: ignore[no-untyped-call]  # TLS: as Dask's own configuration has it
    arguments = security.get_connection_args("client")
    scheduler: Any = rpc(address, timeout=_CONNECT_S, connection_args=arguments)  # type: ignore[no-untyped-call]
    async with scheduler:
        identity: dict[str, Any] = await scheduler.identity()
    return identity
