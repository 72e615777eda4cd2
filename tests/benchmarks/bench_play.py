"""The page of `reenact play`: how soon it is there, and the pictures that arrive at a visitor and are drawn.

    python tests/benchmarks/bench_play.py

What a visitor costs a command is measured by `bench_serve.py`. Nothing is asserted. Compiled kernels are there already.

- From the start of the process of `reenact play` to its address, to the first picture at a client, to a hand of the
  simulated robot that has moved by 5 cm, and to a hand that a client has dragged off its circle to the middle, and that
  is there to 1 cm; and the processor time [s] that was spent by then.
- *pictures that arrive*: those in which a hand moved, a second, at a client in a process of its own that draws nothing;
  by itself, and beside Chromium that draws the page in software, on the same processors as all the rest.
- *drawn*: calls of `requestAnimationFrame` a second that this Chromium managed, and the processor time of each [ms].
- *states*: of the robot a second, as the page takes them; each is answered with targets.

Without Debian's Chromium, the lines about drawing are left out.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from chromium import drawn_page, find_chromium
from page_client import PageClient
from playwright.sync_api import Page as Tab
from processor_time import processor_time_s
from visit import shown_page
from waiting import wait_until

from pipeline.browser.page.page import Page
from pipeline.browser.session.play import PlayConfig
from pipeline.robot.config import load_robot

WATCHED_S = 10.0
STARTS = 3
MOVED_M, NEAR_M = 0.05, 0.01
RIGHT = load_robot("asimo").hands[-1]
COUNT_DRAWN = "() => {window.drawn = 0; const count = () => {window.drawn++; requestAnimationFrame(count)}; count()}"


def start() -> dict[str, tuple[float, float]]:
    """Return when what was reached since `reenact play` began, and the processor time by then [s]."""
    reached: dict[str, tuple[float, float]] = {}
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pipeline", "play", "--no-browser", "--out", folder]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None

            def note(what: str, at_s: float) -> None:
                reached[what] = at_s - began_s, processor_time_s(process.pid)

            line = next(line for line in process.stderr if " is at " in line)
            note("the address", time.monotonic())
            with PageClient(line.split(" is at ")[1].split(";")[0]) as client:
                note("the first picture", client.pictures[0].time_s)
                note("a moving robot", client.await_moved(MOVED_M))
                note("a dragged hand", client.drag(np.array(RIGHT.centre), within_m=NEAR_M))
            process.terminate()
    return reached


def watch(page: Page, tab: Tab | None) -> str:
    """Return a line on the pictures and states of a while."""

    def counts() -> tuple[float, ...]:
        drawn = 0 if tab is None else int(tab.evaluate("() => window.drawn"))
        cpu_s = processor_time_s(os.getpid(), named="chromium")
        return time.monotonic(), page.play.drive.snapshot().states, drawn, cpu_s

    with PageClient(page.address) as client:
        before, first = counts(), len(client.pictures)
        time.sleep(WATCHED_S)
        after, last = counts(), len(client.pictures)
    passed_s, states, drawn, cpu_s = (late - early for early, late in zip(before, after, strict=True))
    line = f"{(last - first) / passed_s:.1f} pictures arrive a second, {states / passed_s:.1f} states a second"
    if tab is None:
        return line
    return f"{line}, {drawn / passed_s:.1f} drawn, at {1e3 * cpu_s / max(1.0, drawn):.0f} ms of processor time each"


def main() -> None:
    for _ in range(STARTS):
        print("; ".join(f"to {what} {at_s:.1f} s ({cpu_s:.1f} s)" for what, (at_s, cpu_s) in start().items()))
    with tempfile.TemporaryDirectory() as name, shown_page(PlayConfig(folder=Path(name))) as page:
        wait_until(lambda: page.play.link.controller and not page.play.activity.doing)
        print(f"a client that draws nothing: {watch(page, None)}")
        if find_chromium() is None:
            print("drawing is not measured: no Chromium on this machine")
            return
        with drawn_page(page.address) as tab:
            tab.evaluate(COUNT_DRAWN)
            print(f"beside a browser without a GPU: {watch(page, tab)}")


if __name__ == "__main__":
    main()
