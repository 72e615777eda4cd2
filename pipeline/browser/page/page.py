"""The page: what runs behind it, shown thirty times a second to whoever looks on, and driven by one of them."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from viser import ClientHandle, ViserServer

from pipeline.arrays import Floats
from pipeline.browser.page.drawing import Sheet, drawn_motion
from pipeline.browser.page.gate import Gate
from pipeline.browser.page.panel import ControllerPart, MotionPart, StatePart
from pipeline.browser.page.record_part import RecordPart
from pipeline.browser.page.scene import Scene
from pipeline.browser.page.server import page_server
from pipeline.browser.page.teaching.controllers_part import ControllersPart
from pipeline.browser.page.teaching.teach_part import TeachPart
from pipeline.browser.page.visitor_bar import VisitorBar, set_theme
from pipeline.browser.page.visitors import Visitors
from pipeline.browser.session.play import Play
from pipeline.browser.teaching.teaching import Teaching
from recorders.threads import background_thread

FRAME_S = 1.0 / 30.0
"""Time from picture to picture [s]."""

_BEHIND_S = 3.0 * FRAME_S  # what is late by more is left out, not made up for
_PANEL_EVERY, _PATHS_EVERY = 6, 6  # frames
_STATUS_S = 0.5
_MAY_NOT = "You look on. Take over to lead the robot."


class Page:
    """Page of what runs; `run` shows it until it is ended.

    Parameters
    ----------
    server : ViserServer
        Serves the page.
    play : Play
        What runs.
    gate : Gate
        Host and token.
    """

    def __init__(self, server: ViserServer, play: Play, gate: Gate) -> None:
        self._server, self.play = server, play
        self.visitors = Visitors()
        self._bars: dict[int, VisitorBar] = {}
        self._over = threading.Event()
        self._controller: dict[str, Any] = {}
        self.address = gate.address(server.get_port())
        set_theme(server, dark=False)
        self.scene = Scene(server, play.robot, on_move=self._move)
        hands = range(len(play.robot.hands))
        self._sheets = [Sheet(server, play.robot, place, on_stroke=self._stroke(place)) for place in hands]
        self._state = StatePart(server, play)
        self._motion = MotionPart(server, play, allowed=self.allowed, on_sheet=self._show_sheet)
        self._choice = ControllerPart(server, play, allowed=self.allowed)
        self._controllers = ControllersPart(server, play)
        self._record = RecordPart(server, play, allowed=self.allowed)
        self.teaching = Teaching(play)
        self._teach = TeachPart(server, play, self.teaching, allowed=self.allowed)
        server.on_client_connect(self._come)
        server.on_client_disconnect(self._go)

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Show what runs until `end` is called, or somebody has stopped it, which is asked for every picture."""
        with background_thread(self._ask, name="status", stop=self.end):
            frame, due_s = 0, time.monotonic()
            while not (self._over.wait(max(0.0, due_s - time.monotonic())) or stopped()):
                self.show(panel=frame % _PANEL_EVERY == 0, paths=frame % _PATHS_EVERY == _PATHS_EVERY // 2)
                frame, due_s = frame + 1, max(due_s + FRAME_S, time.monotonic() - _BEHIND_S)

    def end(self) -> None:
        """End `run`."""
        self._over.set()

    def show(self, *, panel: bool, paths: bool) -> None:
        """Show what is so: the scene, and now and then the panel and the paths."""
        snapshot = self.play.drive.snapshot()
        self.scene.show(snapshot, self.play.link.deviations_m)
        if paths:
            self.scene.show_paths(*self.play.drive.paths())
        if panel:
            self._state.show(snapshot, self._controller)
            self._motion.show(snapshot)
            self._choice.show()
            self._controllers.show()
            self._record.show()
            self._teach.show()
            for bar in list(self._bars.values()):
                bar.show()

    def allowed(self, visitor: int | None) -> bool:
        """Whether a visitor leads; one who does not is told."""
        if self.visitors.leads(visitor):
            return True
        if visitor is not None and (bar := self._bars.get(visitor)) is not None:
            bar.notify(_MAY_NOT)
        return False

    def _ask(self) -> None:
        """Ask the controller what it answered and refused, over and over: on a thread of its own, as it takes time."""
        while not self._over.wait(_STATUS_S):
            self._controller = self.play.link.controller_status()
            self.play.look_after()

    def _move(self, place: int, row: Floats, visitor: int) -> bool:
        if not self.visitors.leads(visitor):
            self.allowed(visitor)
            return False
        self.play.drive.move_hand(place, row)
        return True

    def _stroke(self, place: int) -> Any:
        hand = self.play.robot.hand_names[place]

        def take(times_s: Floats, points: Floats, visitor: int) -> None:
            """Have the robot follow a stroke."""
            if self.allowed(visitor):
                robot, drive = self.play.robot, self.play.drive
                self.play.activity.do(
                    "following the drawing", lambda: drive.go_through(drawn_motion(robot, hand, times_s, points))
                )
                self._motion.stop_drawing()

        return take

    def _show_sheet(self, visible: bool, place: int) -> None:
        for other, sheet in enumerate(self._sheets):
            sheet.show(visible and other == place)
        self.scene.show_handles(not visible)

    def _come(self, client: ClientHandle) -> None:
        self.visitors.come(client.client_id)
        self.scene.fit(client.camera)
        self._bars[client.client_id] = VisitorBar(client, self.visitors)

    def _go(self, client: ClientHandle) -> None:
        self._bars.pop(client.client_id, None)
        self.visitors.go(client.client_id)
        if not len(self.visitors) and self.play.controllers is None:
            self.play.drive.rest()


@contextmanager
def served_page(play: Play, gate: Gate, *, port: int | None) -> Iterator[Page]:
    """Serve the page of what runs while the block runs; raises ConfigError as `page_server` does."""
    with page_server(gate, port=port, label=f"reenact: {play.robot.name}") as server:
        page = Page(server, play, gate)
        try:
            yield page
        finally:
            page.end()
            page.teaching.close()
