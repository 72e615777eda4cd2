"""The panel of the page: state, errors, and what the robot is to do."""

import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from viser import ViserServer

from pipeline.browser.page.elements.error_plot import ErrorPlot
from pipeline.browser.page.elements.texts import hand_rows, joint_rows, paragraph, rows
from pipeline.browser.page.elements.visitor_input import Allowed, VisitorInput, set_visible
from pipeline.browser.session.activity import Activity
from pipeline.browser.session.clock_rate import ClockRate
from pipeline.browser.session.drive import Mode, Snapshot
from pipeline.browser.session.play import Play
from recorders.text.wording import names_text

_HOLD, _PAUSE, _DRAW = "Hold", "Pause", "Draw"
_STATUS = "state"
_WAITS = "No controller answers: errors count only with its commands."
_SLOW = 0.9  # a clock that is slower than this part of real time is stated
_DRAGGED_S = 0.5  # for so long after the last place that a visitor drags the slider to, it stays there


class MotionPart:
    """What moves the hands: handles, a motion that is gone through, or a stroke.

    Parameters
    ----------
    server : ViserServer
        The page.
    play : Play
        What runs.
    allowed : callable
        Whether a visitor may.
    on_sheet : callable
        Takes whether the sheet to draw on is to be seen, and the hand that draws.
    """

    def __init__(
        self, server: ViserServer, play: Play, *, allowed: Allowed, on_sheet: Callable[[bool, int], None]
    ) -> None:
        self._play, self._on_sheet = play, on_sheet
        self._draws, self._hand = False, play.robot.hand_names[-1]
        gui, hands = server.gui, play.robot.hand_names
        with gui.add_folder("Move", order=20):
            gui.add_html(paragraph("Drag a handle in the picture, or:"))
            put = partial(VisitorInput, server, allowed=allowed)
            self._motion = put(gui.add_dropdown("Motion", (_HOLD, *play.motions)), take=self._choose)
            place = gui.add_slider("Place [s]", min=0.0, max=1.0, step=0.02, initial_value=0.0, visible=False)
            self._place = put(place, take=self._seek, rest_s=_DRAGGED_S)
            self._pause = put(gui.add_checkbox(_PAUSE, False, visible=False), take=self._set_paused)
            self._draw = put(gui.add_checkbox(_DRAW, False), take=self._set_drawing)
            hand = gui.add_dropdown("Hand", hands, initial_value=self._hand, visible=False)
            self._drawer = put(hand, take=self._set_hand)

    def stop_drawing(self) -> None:
        """Put the sheet away."""
        self._set_drawing(False)
        self._draw.show(lambda: self._draws)

    def show(self, snapshot: Snapshot) -> None:
        """Show what moves the hands now."""
        loop, motions = snapshot.loop, self._play.motions
        others = () if loop is None or loop.name in motions else (loop.name,)
        self._motion.show(self._name, options=(_HOLD, *motions, *others))
        set_visible(snapshot.mode is Mode.MOTION, self._place.element, self._pause.element)
        if loop is not None:
            if self._place.element.max != loop.duration_s:
                self._place.element.max = loop.duration_s
            self._pause.show(lambda: loop.paused)
            self._place.show(lambda: loop.at_s)
        self._draw.show(lambda: self._draws)
        self._drawer.show(lambda: self._hand)

    def _name(self) -> str:
        """Return the name of the motion of now, as it can be chosen."""
        snapshot = self._play.drive.snapshot()
        return snapshot.loop.name if snapshot.mode is Mode.MOTION and snapshot.loop is not None else _HOLD

    def _choose(self, name: str) -> "Future[None] | None":
        """Hold the hands, or go through a motion that is known by name, or through the last one again."""
        drive, loop = self._play.drive, self._play.drive.snapshot().loop
        if name == _HOLD:
            drive.hold()
        elif name in self._play.motions:
            return self._play.activity.do(f"motion {name}", lambda: self._play.go_through(name))
        elif loop is not None and loop.name == name:
            drive.seek(loop.at_s)
        return None

    def _seek(self, at_s: float) -> None:
        self._play.drive.seek(at_s)

    def _set_paused(self, paused: bool) -> None:
        loop = self._play.drive.snapshot().loop
        if loop is not None:
            loop.paused = paused

    def _set_drawing(self, draws: bool) -> None:
        if draws:
            self._play.drive.hold()
        self._draws = draws
        self._show_sheet()

    def _set_hand(self, hand: str) -> None:
        if hand in self._play.robot.hand_names:
            self._hand = hand
            self._show_sheet()

    def _show_sheet(self) -> None:
        self._on_sheet(self._draws, self._play.robot.hand_names.index(self._hand))
        self._drawer.element.visible = self._draws


class ControllerPart:
    """Choice of the controller that leads, where there are several."""

    def __init__(self, server: ViserServer, play: Play, *, allowed: Allowed) -> None:
        self._play = play
        names = ("",) if play.controllers is None else play.controllers.names
        with server.gui.add_folder("Controller", order=30, visible=play.controllers is not None):
            leads = server.gui.add_dropdown("Leads", names)
        self._choice = VisitorInput(server, leads, allowed=allowed, take=self._choose)

    def show(self) -> None:
        """Show which one leads."""
        if self._play.controllers is not None:
            self._choice.show(lambda: self._play.link.controller, options=self._play.controllers.names)

    def _choose(self, name: str) -> "Future[None] | None":
        controllers = self._play.controllers
        return self._play.choose(name) if controllers is not None and name in controllers.names else None


class StatePart:
    """What is so: robot, controller, errors, what was refused, joints against their limits."""

    def __init__(self, server: ViserServer, play: Play) -> None:
        self._play, self._rate = play, ClockRate()
        gui = server.gui
        self._state = gui.add_html("", order=0)
        self._errors = gui.add_html("", order=1)
        with gui.add_folder("Error of the hands [cm], last 20 s", order=10):
            self._plot = ErrorPlot(server, play.robot.hand_names)
        with gui.add_folder("Joints between their limits", order=90, expand_by_default=False):
            self._joints = gui.add_html("")

    def show(self, snapshot: Snapshot, controller: dict[str, Any]) -> None:
        """Show what is so now."""
        play = self._play
        _set(self._state, state_html(play, snapshot, controller) + self._rate_line(snapshot))
        _set(self._errors, self._error_rows(snapshot))
        _set(self._joints, joint_rows(play.robot, snapshot.q))
        self._plot.show(play.drive.errors())

    def _error_rows(self, snapshot: Snapshot) -> str:
        """Return the errors of the hands, or why there are none."""
        play, error = self._play, snapshot.error
        if error is None:
            return "" if snapshot.mode in (Mode.AT_REST, Mode.LENT) else paragraph(_WAITS, name="waits")
        deviations_m, means_cm = play.link.deviations_m, snapshot.mean.hands_cm
        return hand_rows(play.robot, error.distances_cm, error.turns_deg, deviations_m, means_cm)

    def _rate_line(self, snapshot: Snapshot) -> str:
        """Return a line where the robot's time passes more slowly than that of this machine."""
        if not self._play.link.is_there:
            self._rate.clear()
            return ""
        rate = self._rate.add(time.monotonic(), snapshot.time_ns)
        return "" if rate is None or rate >= _SLOW else paragraph(slow_text(rate), warning=True, name="rate")


def slow_text(rate: float) -> str:
    """Return a line on a robot's clock of a rate beside real time."""
    return f"the robot's time passes at {rate:.2f} of real time: what simulates it is too slow or too busy"


def state_html(play: Play, snapshot: Snapshot, controller: dict[str, Any]) -> str:
    """Return the lines on robot and controller."""
    lines = [_robot_line(play, snapshot), _activity_line(play.activity)]
    if play.link.is_there and not play.activity.doing and not controller:
        lines.append(paragraph("no controller answers the targets", warning=True, name="controller"))
    if controller:
        name = play.link.controller or controller["name"] or "serves"
        lines.append(rows({"controller": f"{name:.60}, {controller['answered']} targets answered"}, name=_STATUS))
        if controller["strange"]:
            differ = f"{name:.60} has learned another robot: {names_text(controller['strange'])} are joints of one only"
            lines.append(paragraph(f"{differ}; {play.robot.name} refuses its commands", warning=True, name="strange"))
    refused = controller.get("refused") or {}
    if refused:
        counts = ", ".join(f"{reason} {count}" for reason, count in refused.items())
        lines.append(
            paragraph(f"refused: {counts}. The last: {controller['last_refusal']}", warning=True, name="refused")
        )
    return "".join(lines)


def _robot_line(play: Play, snapshot: Snapshot) -> str:
    robot = play.robot.name
    if not play.link.is_there:
        own = play.own_robot
        reason = "" if own is None or not own.report else f": {own.report}"
        what = "it is started again" if own is not None and own.report else "the page goes on when it is back"
        first = f"the robot {robot} is gone{reason}" if snapshot.states else f"no robot {robot} reports its state yet"
        return paragraph(f"{first}; {what}", warning=True, name="robot")
    mode = {Mode.AT_REST: "stands there, and nothing is asked of it"}.get(snapshot.mode, str(snapshot.mode))
    return rows({"robot": f"{robot}, {mode}", "time": f"{snapshot.time_ns * 1e-9:.1f} s"}, name=_STATUS)


def _activity_line(activity: Activity) -> str:
    if activity.doing:
        return paragraph(f"{activity.doing} ...", name="doing")
    return paragraph(activity.failure, warning=True, name="failure") if activity.failure else ""


def _set(handle: Any, content: str) -> None:
    """Change a text only where it is another: nothing is sent of what stays."""
    if handle.content != content:
        handle.content = content
