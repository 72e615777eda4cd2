"""A visitor of the page without a browser: sends what a browser sends, over a WebSocket."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import msgspec
import viser
import websockets
from viser import ViserServer
from waiting import wait_until
from websockets.typing import Subprotocol

OURS = f"viser-v{viser.__version__}"

_CAMERA = {
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 0.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 10,
    "image_width": 10,
    "look_at": (1.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def packed(kind: str, **fields: object) -> bytes:
    """Return a message as a browser sends it."""
    return msgspec.msgpack.encode({"type": kind, **fields})


async def sent_by_visitor(port: int, *messages: bytes | str, version: str = OURS) -> None:
    """Send messages as a visitor's browser does, and a question whose answer shows that they were read."""
    async with websockets.connect(f"ws://127.0.0.1:{port}/", subprotocols=[Subprotocol(version)]) as visitor:
        with suppress(websockets.ConnectionClosed):
            for message in messages:
                await visitor.send(message)
            await (await visitor.ping())


class SocketVisitor:
    """A visitor who is there, and sets elements of the panel."""

    def __init__(self, server: ViserServer, visitor: websockets.ClientConnection, runner: asyncio.Runner) -> None:
        self._server, self._visitor, self._runner = server, visitor, runner
        before = set(server.get_clients())
        self._send(packed("ViewerCameraMessage", **_CAMERA))
        wait_until(lambda: set(server.get_clients()) - before)
        (self.number,) = set(server.get_clients()) - before

    def set(self, element: Any, value: object) -> None:
        """Set an element, and wait until the server has taken the value and run what waited on its thread."""
        self._send(packed("GuiUpdateMessage", uuid=element._impl.uuid, updates={"value": value}))
        wait_for_server(self._server)

    def _send(self, message: bytes) -> None:
        async def send() -> None:
            await self._visitor.send(message)
            await (await self._visitor.ping())

        self._runner.run(send())


def wait_for_server(server: ViserServer) -> None:
    """Wait until the server's thread has done what it was given before."""
    asyncio.run_coroutine_threadsafe(asyncio.sleep(0), server.get_event_loop()).result()


@contextmanager
def visiting(server: ViserServer) -> Iterator[SocketVisitor]:
    """Have a visitor there while the block runs."""
    address = f"ws://127.0.0.1:{server.get_port()}/"
    with asyncio.Runner() as runner:

        async def connect() -> websockets.ClientConnection:
            return await websockets.connect(address, subprotocols=[Subprotocol(OURS)], max_size=None, max_queue=None)

        visitor = runner.run(connect())
        try:
            yield SocketVisitor(server, visitor, runner)
        finally:
            runner.run(visitor.close())
