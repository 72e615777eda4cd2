"""Part of the panel that teaches: from recordings, from what the robot does, or by itself; to be kept or undone."""

from collections.abc import Callable
from functools import partial
from typing import Any

from viser import GuiEvent, ViserServer

from pipeline.browser.page.elements.texts import paragraph
from pipeline.browser.page.elements.visitor_input import Allowed, StoredInput, set_visible
from pipeline.browser.page.teaching.learning_plot import LearningPlot
from pipeline.browser.session.play import Play
from pipeline.browser.teaching.teaching import LEAST_S, MOST_S, RULES, Teaching
from recorders.errors import ReenactError

_LIVE, _ALL = "what the robot does now", "all recordings"
_EXPLORING_S = 60


class TeachPart:
    """Choice of what is learned from and by which rule, the error on the way, and what becomes of the controller.

    Parameters
    ----------
    server : ViserServer
        The page.
    play : Play
        What runs.
    teaching : Teaching
        Teaches.
    allowed : callable
        Whether a visitor may.
    """

    def __init__(self, server: ViserServer, play: Play, teaching: Teaching, *, allowed: Allowed) -> None:
        self._play, self._teaching, self._allowed = play, teaching, allowed
        gui = server.gui
        put, own = partial(StoredInput, server, allowed=allowed), play.controllers is not None
        with gui.add_folder("Teach", order=50):
            self._source = put(gui.add_dropdown("From", (_LIVE, _ALL)))
            self._rule = put(gui.add_dropdown("Rule", RULES))
            self._learn: Any = gui.add_button("Learn")
            self._seconds = put(
                gui.add_number("Alone for [s]", _EXPLORING_S, min=LEAST_S, max=MOST_S, step=1, visible=own)
            )
            self._explore: Any = gui.add_button("Explore by itself", visible=own)
            self._line: Any = gui.add_html("")
            self._bar: Any = gui.add_progress_bar(0.0, visible=False)
            self._finish: Any = gui.add_button("Finish now", visible=False)
            self._cancel: Any = gui.add_button("Cancel", visible=False, color="gray")
            self._plot = LearningPlot(server, play.robot.hand_names)
            self._name = put(gui.add_text("Keep as", "", visible=False))
            self._keep: Any = gui.add_button("Keep", visible=False)
            self._undo: Any = gui.add_button("Undo", visible=False, color="gray")
        self._offered = ""
        for button, work in (
            (self._learn, self._begin),
            (self._explore, lambda: teaching.explore(self._seconds.value)),
            (self._finish, teaching.finish),
            (self._cancel, teaching.cancel),
            (self._keep, lambda: teaching.keep(str(self._name.value))),
            (self._undo, teaching.undo),
        ):
            button.on_click(self._pressed(work))

    @property
    def source(self) -> str:
        """What is chosen to learn from."""
        return str(self._source.value)

    def show(self) -> None:
        """Show the lesson of now, or what became of the last."""
        teaching = self._teaching
        lesson, taught = teaching.lesson, teaching.taught
        share = None if lesson is None else lesson.share
        self._set_bar(share)
        set_visible(lesson is None, self._learn, self._source.element, self._rule.element)
        set_visible(lesson is None and self._play.controllers is not None, self._explore, self._seconds.element)
        set_visible(lesson is not None, self._cancel)
        set_visible(lesson is not None and lesson.can_finish, self._finish)
        set_visible(lesson is None and taught is not None, self._name.element, self._keep, self._undo)
        if taught is not None and taught.name != self._offered:
            self._offered = self._name.value = taught.name
        self._show_values()
        self._plot.show(teaching.curve)
        content = self._text()
        if self._line.content != content:
            self._line.content = content

    def _show_values(self) -> None:
        self._source.show_value(options=(_LIVE, _ALL, *self._play.recordings.logs()))
        self._rule.show_value(options=RULES)
        self._seconds.show_value()
        self._name.show_value()

    def _text(self) -> str:
        teaching = self._teaching
        if lesson := teaching.lesson:
            last_cm = lesson.curve.last_cm
            off = "" if last_cm is None else f"; now {last_cm:.2f} cm off"
            return paragraph(f"{lesson.title}{off} ...", name="lesson")
        if teaching.failure:
            return paragraph(teaching.failure, warning=True, name="lesson-failure")
        return paragraph(teaching.line, name="taught") if teaching.line else ""

    def _set_bar(self, share: float | None) -> None:
        set_visible(share is not None, self._bar)
        percent = round(100.0 * (share or 0.0))
        if self._bar.value != percent:
            self._bar.value = percent

    def _begin(self) -> None:
        source, rule = self.source, str(self._rule.value)
        if source == _LIVE:
            self._teaching.learn_live(rule)
        else:
            logs = self._play.recordings.logs() if source == _ALL else (source,)
            self._teaching.learn(rule, logs)

    def _pressed(self, work: Callable[[], object]) -> Callable[[GuiEvent[Any]], None]:
        def press(event: GuiEvent[Any]) -> None:
            """Do what a button does, and keep why it cannot."""
            if not self._allowed(event.client_id):
                return
            try:
                work()
            except (ReenactError, OSError) as error:
                self._teaching.failure = str(error)

        return press
