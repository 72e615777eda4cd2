"""The panel of the page: state, errors, and what the robot is to do."""

from collections.abc import Callable
from typing import Any

from viser import GuiEvent, ViserServer

from pipeline.browser.page.error_plot import ErrorPlot
from pipeline.browser.page.texts import hand_rows, joint_rows, paragraph, rows
from pipeline.browser.session.activity import Activity
from pipeline.browser.session.drive import Mode, Snapshot
from pipeline.browser.session.play import Play
from recorders.text.wording import names_text

_HOLD, _PAUSE, _DRAW = "Hold", "Pause", "Draw"
_STATUS = "state"

Allowed = Callable[[int | None], bool]
"""Whether a visitor, by number, may do something; it is told if not."""


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
        self._play, self._allowed, self._on_sheet = play, allowed, on_sheet
        gui, hands = server.gui, play.robot.hand_names
        with gui.add_folder("Move", order=20):
            gui.add_html(paragraph("Drag a handle in the picture, or:"))
            self._motion: Any = gui.add_dropdown("Motion", (_HOLD, *play.motions))
            self._place: Any = gui.add_slider(
                "Place [s]", min=0.0, max=1.0, step=0.02, initial_value=0.0, visible=False
            )
            self._pause: Any = gui.add_checkbox(_PAUSE, initial_value=False, visible=False)
            self._draw: Any = gui.add_checkbox(_DRAW, initial_value=False)
            self._hand: Any = gui.add_dropdown("Hand", hands, initial_value=hands[-1], visible=False)
        self._shown: Any = None
        self._motion.on_update(self._choose)
        self._place.on_update(self._seek)
        self._pause.on_update(self._set_paused)
        self._draw.on_update(self._set_drawing)
        self._hand.on_update(self._set_drawing)

    def stop_drawing(self) -> None:
        """Put the sheet away."""
        self._draw.value = False
        self._show_sheet()

    def show(self, snapshot: Snapshot) -> None:
        """Show what moves the hands now."""
        loop = snapshot.loop if snapshot.mode is Mode.MOTION else None
        name = _HOLD if loop is None else loop.name
        if name not in self._motion.options:
            self._motion.options = (*self._motion.options, name)
        if self._shown != (name, loop is not None):
            self._shown = name, loop is not None
            self._motion.value = name
            self._place.visible = self._pause.visible = loop is not None
        if loop is not None:
            if self._place.max != loop.duration_s:
                self._place.max = loop.duration_s
            self._pause.value = loop.paused
            if not loop.paused:
                self._place.value = loop.at_s

    def _choose(self, event: GuiEvent[Any]) -> None:
        if event.client_id is None or event.target.value == (self._shown or ("",))[0]:
            return
        name, self._shown = event.target.value, None
        if not self._allowed(event.client_id):
            return
        if name == _HOLD:
            self._play.drive.hold()
        elif name in self._play.motions:
            self._play.activity.do(f"motion {name}", lambda: self._play.go_through(name))

    def _seek(self, event: GuiEvent[Any]) -> None:
        if event.client_id is not None and self._allowed(event.client_id):
            self._play.drive.seek(float(event.target.value))

    def _set_paused(self, event: GuiEvent[Any]) -> None:
        loop = self._play.drive.snapshot().loop
        if event.client_id is not None and loop is not None and self._allowed(event.client_id):
            loop.paused = bool(event.target.value)

    def _set_drawing(self, event: GuiEvent[Any]) -> None:
        if event.client_id is None or self._hand.value not in self._play.robot.hand_names:
            return
        if not self._allowed(event.client_id):
            self._draw.value = False
            return
        if self._draw.value:
            self._play.drive.hold()
        self._show_sheet()

    def _show_sheet(self) -> None:
        names, hand = self._play.robot.hand_names, self._hand.value
        self._hand.visible = self._draw.value
        self._on_sheet(self._draw.value, names.index(hand) if hand in names else len(names) - 1)


class ControllerPart:
    """Choice of the controller that leads, where there are several."""

    def __init__(self, server: ViserServer, play: Play, *, allowed: Allowed) -> None:
        self._play, self._allowed = play, allowed
        names = ("",) if play.controllers is None else play.controllers.names
        with server.gui.add_folder("Controller", order=30, visible=play.controllers is not None):
            self._choice: Any = server.gui.add_dropdown("Leads", names)
        self._choice.on_update(self._choose)

    def show(self) -> None:
        """Show which one leads."""
        if self._play.controllers is None:
            return
        names, leading = self._play.controllers.names, self._play.link.controller
        if self._choice.options != names:
            self._choice.options = names
        if leading in names and self._choice.value != leading and not self._play.activity.doing:
            self._choice.value = leading

    def _choose(self, event: GuiEvent[Any]) -> None:
        name = event.target.value
        if event.client_id is None or name == self._play.link.controller:
            return
        if self._allowed(event.client_id) and name in self._choice.options:
            self._play.choose(name)
        else:
            self._choice.value = self._play.link.controller


class StatePart:
    """What is so: robot, controller, errors, what was refused, joints against their limits."""

    def __init__(self, server: ViserServer, play: Play) -> None:
        self._play = play
        gui = server.gui
        self._state = gui.add_html("", order=0)
        self._errors = gui.add_html("", order=1)
        with gui.add_folder("Error of the hands [cm], last 20 s", order=10):
            self._plot = ErrorPlot(server, play.robot.hand_names)
        with gui.add_folder("Joints between their limits", order=90, expand_by_default=False):
            self._joints = gui.add_html("")

    def show(self, snapshot: Snapshot, controller: dict[str, Any]) -> None:
        """Show what is so now."""
        play, error, mean = self._play, snapshot.error, snapshot.mean
        _set(self._state, state_html(play, snapshot, controller))
        if error is not None:
            deviations_m = play.link.deviations_m
            _set(self._errors, hand_rows(play.robot, error.distances_cm, error.turns_deg, deviations_m, mean.hands_cm))
        _set(self._joints, joint_rows(play.robot, snapshot.q))
        self._plot.show(play.drive.errors())


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
