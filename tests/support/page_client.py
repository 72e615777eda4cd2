"""A client of the page without a browser, in a process of its own: takes pictures as they arrive, and drags a hand."""

import subprocess
import sys
import threading
import time
from types import TracebackType
from typing import Any, NamedTuple, Self
from urllib.parse import urlsplit

import msgspec
import numpy as np
import viser
import zstandard
from waiting import wait_until
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from pipeline.arrays import Floats

SIZE = (1280, 800)
HALO, HANDLE = "/hands/right/halo", "/handles/right"


class Picture(NamedTuple):
    """Arrival of a picture [s], by the monotonic clock, and the right hand in it [m], shape (3,)."""

    time_s: float
    hand: Floats


class PageClient:
    """Client of the page at an address, until the block ends."""

    def __init__(self, address: str) -> None:
        command = [sys.executable, __file__, address]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._thread = threading.Thread(target=self._take)
        self.pictures: list[Picture] = []

    def __enter__(self) -> Self:
        self._thread.start()
        wait_until(lambda: self.pictures or self._process.poll() is not None)
        assert self.pictures
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join()

    def await_moved(self, least_m: float) -> float:
        """Return when a hand had moved by so much since the first picture [s]."""
        return self._await(lambda hand: float(np.linalg.norm(hand - self.pictures[0].hand)) >= least_m, begin=0)

    def drag(self, target: Floats, *, within_m: float) -> float:
        """Drag the right hand to a place [m], shape (3,), and return when it was there [s]."""
        begin = len(self.pictures)
        assert self._process.stdin is not None
        self._process.stdin.write(" ".join(map(str, target.tolist())) + "\n")
        self._process.stdin.flush()
        return self._await(lambda hand: float(np.linalg.norm(hand - target)) <= within_m, begin=begin)

    def _await(self, holds: Any, *, begin: int) -> float:
        found: list[float] = []

        def look() -> bool:
            found.extend(picture.time_s for picture in self.pictures[begin:] if holds(picture.hand))
            return bool(found)

        wait_until(look)
        return found[0]

    def _take(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            time_s, *hand = map(float, line.split())
            self.pictures.append(Picture(time_s, np.array(hand)))


def _messages(frame: bytes) -> list[dict[str, Any]]:
    compressed = int.from_bytes(frame[8:16], "little")  # what follows is numbers as they are
    found: list[dict[str, Any]] = msgspec.msgpack.decode(zstandard.decompress(frame[16 : 16 + compressed]))["messages"]
    return found


def _look(socket: Connection) -> None:
    """Send where it looks from: before that, nobody is a visitor."""
    lens = {"fov": 1.0, "near": 0.01, "far": 100.0, "image_height": SIZE[1], "image_width": SIZE[0]}
    place = {"position": (2.0, 0.0, 1.0), "look_at": (0.0, 0.0, 1.0), "up_direction": (0.0, 0.0, 1.0)}
    _send(socket, "ViewerCameraMessage", wxyz=(0.5, 0.5, 0.5, 0.5), **lens, **place)


def _send(socket: Connection, kind: str, **fields: object) -> None:
    socket.send(msgspec.msgpack.encode({"type": kind, **fields}))


def _drag(socket: Connection) -> None:
    """Send what a browser does when a handle is dragged, to each place that a line names."""
    for line in sys.stdin:
        position = tuple(map(float, line.split()))
        _send(socket, "TransformControlsDragStartMessage", name=HANDLE, owner="")
        _send(
            socket,
            "TransformControlsUpdateMessage",
            name=HANDLE,
            owner="",
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=position,
        )
        _send(socket, "TransformControlsDragEndMessage", name=HANDLE, owner="")


def main() -> None:
    """Print a line for each picture of the page whose address is the argument."""
    protocol: Any = f"viser-v{viser.__version__}"
    where = f"ws://{urlsplit(sys.argv[1]).netloc}"
    with connect(where, subprotocols=[protocol], max_size=None, compression=None) as socket:
        _look(socket)
        threading.Thread(target=_drag, args=(socket,), daemon=True).start()
        for frame in socket:
            now_s = time.monotonic()
            assert isinstance(frame, bytes)
            for message in _messages(frame):
                if message["type"] == "SetPositionMessage" and message["name"] == HALO:
                    print(now_s, *message["position"], flush=True)


if __name__ == "__main__":
    main()
