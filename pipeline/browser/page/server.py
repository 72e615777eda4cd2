"""Web server of the page: viser's, behind the gate, which sends nothing anywhere else."""

import asyncio
import contextlib
import io
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from viser import ViserServer, _messages
from viser.infra import WebsockClientConnection

from pipeline.browser.page.gate import Gate
from recorders.errors import ConfigError
from recorders.text.wording import escape_control

logger = logging.getLogger(__name__)

PORT = 8080
"""Port of the page unless another is asked for; the next one that is free where this is taken."""

_TRIES = 100


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
    with contextlib.redirect_stdout(io.StringIO()):  # a box with addresses that are not those with a token
        server = ViserServer(host=gate.host, port=chosen, label=label, verbose=False)
    _guard(server, gate)
    _keep_to_itself(server)
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _guard(server: ViserServer, gate: Gate) -> None:
    """Have a server turn away whoever the gate refuses, before anything is sent to it or taken from it."""
    websockets = server._websock_server
    seen: set[str] = set()  # strangers can cause a line: each is logged once

    async def on_connect(client: WebsockClientConnection) -> None:
        connection = websockets._live_connections[client.client_id]
        request = connection.request
        reason = "it is no request" if request is None else gate.refusal(request.path, request.headers)
        if not reason:
            return
        if reason not in seen:
            seen.add(reason)
            logger.warning(f"turned away a visitor: {escape_control(reason)}")
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
