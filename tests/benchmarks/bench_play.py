"""The page of `reenact play`: frames that a visitor gets and draws, when it is there, and what it costs a command.

    python tests/benchmarks/bench_play.py

Needs Debian's Chromium, and measures nothing where that is missing. Without a GPU it draws in software, on the same
processors as all the rest, which is why what arrives and what is drawn are counted apart. Nothing is asserted.

- *to the address*, *to a moving robot*: from the start of `reenact play` until it prints where the page is, and until
  the simulated robot's hands have moved by a centimetre. Compiled kernels are there already.
- *frames that arrive*: messages a second from the page's server to the browser that move the robot's hands; *frames
  drawn*: calls of `requestAnimationFrame` that the browser managed in the same while.
- *states*: of the robot a second, as the page takes them; each is answered with targets.
- *target to command*: of a controller that is served to the robot as the page drives it, the median of the last
  commands as `serve` itself measures it, without a visitor and with one whose browser draws.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from chromium import chromium, find_chromium
from small_inverse import taught
from visit import shown_page, wait_until

from pipeline.browser.page.page import Page
from pipeline.browser.session.play import FIRST_MOTION, PlayConfig
from recorders.nodes.keys import controller_key
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE

WATCHED_S = 10.0
MOVED_M = 0.01
SIZE = {"width": 1280, "height": 800}
HALO = b"/hands/right/halo"
COUNT_DRAWN = "() => {window.drawn = 0; const count = () => {window.drawn++; requestAnimationFrame(count)}; count()}"


def time_to_address() -> float:
    """Return how long `reenact play` takes to print its address [s]."""
    began_s = time.monotonic()
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            [sys.executable, "-m", "pipeline", "play", "--no-browser", "--out", folder],
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        assert process.stderr is not None
        line = next(line for line in process.stderr if " is at " in line)
        passed_s = time.monotonic() - began_s
        process.terminate()
    assert "http://" in line
    return passed_s


def time_to_move(page: Page, began_s: float) -> float:
    """Return how long after an instant the robot's hands have moved [s]."""
    wait_until(lambda: page.play.drive.snapshot().states)
    first = page.play.drive.snapshot().hands
    wait_until(lambda: np.abs(page.play.drive.snapshot().hands - first).max() > MOVED_M)
    return time.monotonic() - began_s


def counted(page: Page, counts: Callable[[], list[int]]) -> list[float]:
    """Return by how much counts and the states of the robot grow a second."""
    before, begin_s = [*counts(), page.play.drive.snapshot().states], time.monotonic()
    time.sleep(WATCHED_S)
    after, passed_s = [*counts(), page.play.drive.snapshot().states], time.monotonic() - begin_s
    return [(late - early) / passed_s for early, late in zip(before, after, strict=True)]


def latency_us(page: Page) -> dict[str, float]:
    """Return what `serve` has measured of its last commands [us]."""
    key = controller_key(DEFAULT_NAMESPACE, page.play.link.controller, "status")
    (reply,) = page.play.recordings.place.session.get(key, timeout=10.0)
    status: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
    return dict(status["latency_us"])


def visited(page: Page) -> tuple[list[float], dict[str, float]]:
    """Return frames that arrive and are drawn and states a second, and the latency of the controller meanwhile."""
    arrived = 0

    def count(frame: bytes | str) -> None:
        nonlocal arrived
        if isinstance(frame, bytes):
            compressed = int.from_bytes(frame[8:16], "little")  # of the message; what follows is numbers as they are
            arrived += HALO in zstandard.decompress(frame[16 : 16 + compressed])

    with chromium() as browser:
        tab = browser.new_page(viewport=SIZE)
        tab.on("websocket", lambda socket: socket.on("framereceived", count))
        tab.goto(page.address)
        tab.locator("[data-reenact='visitor']").wait_for()
        tab.evaluate(COUNT_DRAWN)

        def counts() -> list[int]:
            drawn = int(tab.evaluate("() => window.drawn"))  # first: all that arrived before is counted with it
            return [arrived, drawn]

        return counted(page, counts), latency_us(page)


def main() -> None:
    if find_chromium() is None:
        print("the page is not measured: no Chromium on this machine")
        return
    print(f"to the address {time_to_address():.1f} s")
    with tempfile.TemporaryDirectory() as name:
        controller = Path(name) / "learned.npz"
        taught().save(controller)
        began_s = time.monotonic()
        with shown_page(PlayConfig(folder=Path(name))) as page:
            print(f"to a moving robot {time_to_move(page, began_s):.1f} s (imports aside)")
        with shown_page(PlayConfig(robot="asimo", controllers=(controller,), folder=Path(name))) as page:
            wait_until(lambda: page.play.link.controller == "learned")
            page.play.go_through(FIRST_MOTION)
            (states,) = counted(page, list)
            print(f"without a visitor: {states:.1f} states a second, target to command {latency_us(page)}")
            (arrive, drawn, states), latency = visited(page)
            print(f"with a visitor: {states:.1f} states a second, target to command {latency}")
            print(f"{arrive:.1f} frames arrive a second, {drawn:.1f} are drawn")


if __name__ == "__main__":
    main()
