"""A visitor of the page, in a real Chromium, and the page with what runs behind it."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle, pairwise

import numpy as np
from chromium import on_screen
from playwright.sync_api import Browser
from waiting import wait_until

from pipeline.arrays import Floats
from pipeline.browser.page.gate import Gate
from pipeline.browser.page.page import Page, served_page
from pipeline.browser.session.play import PlayConfig, playing

SIZE = (900, 640)
PHONE = (390, 844)
ARRIVED_CM = 0.2
_PATIENCE_MS = 120_000
_NEAR_M, _SHAKING_M = 0.015, 0.005  # a few pixels
_NO_PICTURES = """
for (const name of ["clear", "drawArrays", "drawArraysInstanced", "drawElements", "drawElementsInstanced"])
  WebGL2RenderingContext.prototype[name] = () => {};
"""
"""The page does all of its work, but draws no robot: no test looks at one, and software WebGL takes
more of a processor than all else that runs for a test."""
PANEL_ALONE = ("--disable-gpu-compositing", "--disable-gpu-rasterization")
"""Arguments of a Chromium that draws the panel without software WebGL, which takes ten times as long."""
_TWO_FRAMES = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


class Visit:
    """One visitor of the page, with a mouse, or on a phone with a finger."""

    def __init__(self, browser: Browser, page: Page, *, on_phone: bool = False) -> None:
        self._page, self._size, self._on_phone = page, PHONE if on_phone else SIZE, on_phone
        before = set(page._server.get_clients())
        width, height = self._size
        context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=on_phone, is_mobile=on_phone
        )
        context.add_init_script(_NO_PICTURES)
        self.tab = context.new_page()
        self._touch = context.new_cdp_session(self.tab)
        self.requested: list[str] = []
        self.tab.on("request", lambda request: self.requested.append(request.url))
        self.tab.on("websocket", lambda socket: self.requested.append(socket.url))
        self.tab.set_default_timeout(_PATIENCE_MS)
        self.tab.goto(f"{page.address}/?fixedDpr=0.5")
        self.await_client(before)

    def await_client(self, before: set[int]) -> None:
        wait_until(lambda: set(self._page._server.get_clients()) - before and self.shown("visitor"))
        (self.number,) = set(self._page._server.get_clients()) - before

    def shown(self, name: str) -> str:
        found = self.tab.locator(f'[data-reenact="{name}"]')
        return found.first.inner_text() if found.count() else ""

    def await_shown(self, name: str, text: str) -> None:
        wait_until(lambda: text in self.shown(name))

    def await_taught(self, text: str) -> None:
        wait_until(lambda: text in self.shown("taught") or self.shown("lesson-failure"))
        assert not self.shown("lesson-failure")

    def at(self, point: Floats) -> tuple[float, float]:
        return on_screen(self._page._server.get_clients()[self.number].camera, point, self._size)

    def await_seen(self) -> None:
        """Wait until the browser has drawn what is so now, if the robot is there: it is pressed where it is seen."""
        play = self._page.play
        due_s = play.drive.snapshot().time_ns * 1e-9 + 0.1
        wait_until(lambda: not play.link.is_there or float(self.shown("state:time").split(" ")[0] or 0.0) >= due_s)
        self.tab.evaluate(_TWO_FRAMES)

    def press(self, point: Floats) -> None:
        """Press at a point of the world [m]."""
        self.await_seen()
        x, y = self.at(point)
        if self._on_phone:
            self._finger("touchStart", x, y)
        else:
            self.tab.mouse.move(x, y, steps=3)
            self.tab.mouse.down()

    def move(self, point: Floats) -> None:
        """Go to a point of the world [m]."""
        x, y = self.at(point)
        if self._on_phone:
            self._finger("touchMove", x, y)
        else:
            self.tab.mouse.move(x, y, steps=3)

    def drag(self, *points: Floats) -> None:
        """Press at the first point of the world [m], go through all, and let go."""
        self.press(points[0])
        for point in points[1:]:
            self.move(point)
        self.let_go()

    def draw(self, place: int, *points: Floats) -> None:
        """Bring out the sheet, and draw through points of it [m], each of which has come there before the next."""
        self.tab.get_by_label("Draw").click()
        self.tab.get_by_label("Hand", exact=True).wait_for()  # which is seen after the sheet
        self.press(points[0])
        for begin, end in pairwise(points):
            for share in (0.5, 1.0):
                self._draw_to(place, begin + share * (end - begin))
        self.let_go()

    def _draw_to(self, place: int, point: Floats) -> None:
        """Move about a point until it has come there: a browser sends where a pointer was last once it moves again."""
        sheet, shaking = self._page._sheets[place], cycle(_SHAKING_M * np.outer((1.0, -1.0), self._page.play.robot.up))

        def is_there() -> bool:
            """Whether the stroke has come there, after another move."""
            self.move(point + next(shaking))
            return bool(sheet._stroke) and bool(np.linalg.norm(sheet._stroke[-1][1] - point) < _NEAR_M)

        wait_until(is_there)

    def let_go(self) -> None:
        """Let go of what is dragged."""
        if self._on_phone:
            self._finger("touchEnd")
        else:
            self.tab.mouse.up()

    def drag_handle(self, place: int, metres: float) -> None:
        """Drag the handle of a hand by its arrow along the robot's left [m]."""
        left = self._page.play.robot.lateral
        grip = self.grip(place)
        self.drag(grip, grip + 0.5 * metres * left, grip + metres * left)

    def grip(self, place: int) -> Floats:
        """Return where the handle of a hand is held to be dragged along the robot's left [m], once it stands still."""
        drive, scene = self._page.play.drive, self._page.scene
        wait_until(lambda: np.abs(scene.handle_position(place) - drive.snapshot().wanted[place, :3]).max() < 1e-3)
        return self._page.scene.handle_position(place) + 0.1 * self._page.play.robot.lateral

    def close(self) -> None:
        self.tab.context.close()

    def _finger(self, kind: str, *place: float) -> None:
        points = [dict(zip("xy", place, strict=True))] if place else []
        self._touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


@contextmanager
def shown_page(config: PlayConfig) -> Iterator[Page]:
    """Show the page of what runs while the block runs."""
    with playing(config) as play, served_page(play, Gate(), port=None) as page:
        thread = threading.Thread(target=page.run)
        thread.start()
        try:
            yield page
        finally:
            page.end()
            thread.join()


def await_arrival(page: Page, *, within_cm: float = ARRIVED_CM) -> None:
    """Wait until all targets are where they are wanted, and the hands there too."""

    def arrived() -> bool:
        now = page.play.drive.snapshot()
        if now.error is None or np.abs(now.targets - now.wanted).max() >= 1e-4:
            return False
        return bool(now.error.distances_cm.max() < within_cm)

    wait_until(arrived)
