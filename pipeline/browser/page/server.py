"""Web server of the page: viser's, behind the gate, which sends nothing anywhere else."""

import asyncio
import logging
import socket
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rich
from viser import ViserServer, _messages
from viser.infra import WebsockClientConnection

from pipeline.browser.page.gate import Gate
from recorders.errors import ConfigError
from recorders.text.once import OnceWarner

logger = logging.getLogger(__name__)

PORT = 8080
"""Port of the page unless another is asked for; the next one that is free where this is taken."""

_TRIES = 100
_MOST_LINES = 8  # strangers can cause them
_LONGEST = 200


@contextmanager
def page_server(gate: Gate, *, port: int | None, label: str) -> Iterator[ViserServer]:
    """Serve an empty page while the block runs.

    Parameters
    ----------
    gate : Gate
        Host and token.
    port : int or None
        Port; if left out, `PORT` or the next one that is free.
    label : str
        Title of the panel.

    Raises
    ------
    ConfigError
        If the port cannot be listened on.
    """
    chosen = _free_port(gate.host) if port is None else port
    if port is not None and (reason := _taken(gate.host, port)):
        raise ConfigError(f"--port {port}: {reason}; give another one, or none")
    warner = OnceWarner(logger, limit=_MOST_LINES, longest=_LONGEST)
    with _quiet_console(), _lines_of_websockets(warner):
        server = ViserServer(host=gate.host, port=chosen, label=label, verbose=False)
        loop = server._websock_server._background_event_loop
        if loop is not None:
            loop.call_soon_threadsafe(loop.set_exception_handler, lambda _loop, context: _warn(warner, context))
        server._websock_server._broadcast_buffer.message_event = _ThreadEvent()
        _guard(server, gate, warner)
        _keep_to_itself(server)
        try:
            yield server
        finally:
            server.stop()


class _ThreadEvent(asyncio.Event):
    """Event that other threads than its loop's may set: viser sets it so, and then on the loop, which wakes who waits.

    One of asyncio's goes through its waiters, which the loop may change meanwhile: what is shown would be an error.
    """

    def set(self) -> None:
        """Set it; only on its loop are waiters woken."""
        if asyncio._get_running_loop() is None:
            self._value = True
            return
        self._value = False  # else waiters are taken to be awake
        super().set()


@contextmanager
def _quiet_console() -> Iterator[None]:
    """Have viser print nothing: neither addresses without the token, nor a line for whatever a visitor sends."""
    console = rich.get_console()
    earlier, console.quiet = console.quiet, True
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=r"\[viser\]")
            yield
    finally:
        console.quiet = earlier


@contextmanager
def _lines_of_websockets(warner: OnceWarner) -> Iterator[None]:
    """Have what anybody can send to the port cause a line, once, and no traceback."""

    def pass_on(record: logging.LogRecord) -> bool:
        """Pass on an error as a line, and drop the record."""
        if record.levelno >= logging.WARNING:
            _warn(warner, {"message": record.getMessage(), "exception": (record.exc_info or (None, None))[1]})
        return False

    websockets = logging.getLogger("websockets.server")
    websockets.addFilter(pass_on)
    try:
        yield
    finally:
        websockets.removeFilter(pass_on)


def _warn(warner: OnceWarner, context: dict[str, Any]) -> None:
    """Warn of what failed while a connection was served; of each kind of it once."""
    what, error = str(context["message"]), context.get("exception")
    kind = f"{what}: {type(error).__name__}"
    warner.warn(f"the page dropped what a connection sent: {what}{f' ({error})' if error else ''}", kind=kind)


def _guard(server: ViserServer, gate: Gate, warner: OnceWarner) -> None:
    """Have a server turn away whoever the gate refuses, before anything is sent to it or taken from it."""
    websockets = server._websock_server

    async def on_connect(client: WebsockClientConnection) -> None:
        client.get_message_buffer().message_event = _ThreadEvent()
        connection = websockets._live_connections[client.client_id]
        request = connection.request
        reason = "it is no request" if request is None else gate.refusal(request.path, request.headers)
        if not reason:
            return
        warner.warn(f"turned away a visitor: {reason}")
        websockets._live_connections.pop(client.client_id, None)
        websockets._client_state_from_id.pop(client.client_id, None)
        await connection.close(1008, reason)
        raise asyncio.CancelledError  # ends what handles this connection, and nothing else

    websockets.on_client_connect(on_connect)


def _keep_to_itself(server: ViserServer) -> None:
    """Have a server never ask a service elsewhere to share the page, as any visitor could have it do."""
    for request in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(request)


def _free_port(host: str) -> int:
    for port in range(PORT, PORT + _TRIES):
        if not _taken(host, port):
            return port
    raise ConfigError(f"ports {PORT} to {PORT + _TRIES - 1}: expected one that is free, found none; give --port")


def _taken(host: str, port: int) -> str:
    """Return why a port cannot be listened on, empty if it can."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            return error.strerror or str(error)
        except OverflowError:
            return "expected 0 to 65535"
    return ""
