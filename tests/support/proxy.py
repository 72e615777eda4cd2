"""A TCP proxy on loopback that cuts what it carries, and restores it."""

import math
import socket
import threading
from contextlib import suppress
from types import TracebackType
from typing import Self

from recorders.wire.loopback import free_endpoint


class Proxy:
    """Carries connections to an endpoint; while it is cut, it drops every one."""

    def __init__(self, target: str) -> None:
        self.endpoint = free_endpoint()
        self.carried = 0
        self.is_cut = threading.Event()
        self._cut_at: float = math.inf  # bytes carried
        self._target = _address(target)
        self._connections: list[socket.socket] = []
        self._lock = threading.Lock()
        self._listener = socket.create_server(_address(self.endpoint))

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def cut(self) -> None:
        with self._lock:
            self._drop()

    def cut_after(self, count: int) -> None:
        """Cut once so many bytes more were carried: in the middle of them, whatever else the machine does."""
        self._cut_at = self.carried + count

    def restore(self) -> None:
        self.is_cut.clear()

    def _drop(self) -> None:
        self._cut_at = math.inf
        self.is_cut.set()
        for connection in self._connections:
            _hang_up(connection)
        self._connections.clear()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                near, _ = self._listener.accept()
                self._join(near)

    def _join(self, near: socket.socket) -> None:
        with self._lock:
            try:
                if self.is_cut.is_set():
                    raise ConnectionError
                far = socket.create_connection(self._target)
            except OSError:
                _hang_up(near)
                return
            self._connections += [near, far]
        for source, sink in ((near, far), (far, near)):
            threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
                with self._lock:
                    self.carried += len(data)
                    if self.carried >= self._cut_at:
                        self._drop()
        _hang_up(source)
        _hang_up(sink)


def _address(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    return host, int(port)


def _hang_up(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
    connection.close()
