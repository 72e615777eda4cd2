"""Part of the panel that records, and goes through what was recorded."""

from concurrent.futures import Future
from typing import Any

from viser import GuiEvent, ViserServer

from pipeline.browser.page.elements.texts import paragraph
from pipeline.browser.page.elements.visitor_input import Allowed, StoredInput, VisitorInput
from pipeline.browser.page.visitor_bar import notify
from pipeline.browser.session.play import Play

_BEGIN, _END, _NONE = "Record", "End the recording", "(choose a log)"
_BEGINNING, _ENDING = "beginning to record", "ending the recording"


class RecordPart:
    """Button that begins and ends a recording, its figures, and the logs to go through.

    Parameters
    ----------
    server : ViserServer
        The page.
    play : Play
        What runs.
    allowed : callable
        Whether a visitor may.
    """

    def __init__(self, server: ViserServer, play: Play, *, allowed: Allowed) -> None:
        self._play, self._allowed = play, allowed
        self._line, self._renamed = "", ""
        gui = server.gui
        with gui.add_folder("Record", order=40):
            name = gui.add_text("Name", initial_value="demonstration")
            self._button: Any = gui.add_button(_BEGIN)
            self._figures: Any = gui.add_html("")
            logs = gui.add_dropdown("Play", (_NONE,))
        self._name = StoredInput(server, name, allowed=allowed)
        self._logs = VisitorInput(server, logs, allowed=allowed, take=self._choose)
        self._button.on_click(self._press)

    def show(self) -> None:
        """Show what is recorded, and which logs there are."""
        recording, activity = self._play.recordings.under_way, self._play.activity
        label = _BEGIN if recording is None else _END
        if self._button.label != label:
            self._button.label = label
        if recording is not None and not activity.doing:
            ticks = self._play.drive.snapshot().mean.ticks
            self._line = f"recording {recording.name}: {ticks} targets so far{self._renamed}"
        line = f"{activity.doing} ..." if activity.doing in (_BEGINNING, _ENDING) else self._line
        content = paragraph(line, name="recording") if line else ""
        if self._figures.content != content:
            self._figures.content = content
        self._name.show_value()
        self._logs.show(lambda: _NONE, options=(_NONE, *self._play.recordings.logs()))

    def _press(self, event: GuiEvent[Any]) -> None:
        if not self._allowed(event.client_id):
            return
        if doing := self._play.activity.doing:
            if event.client is not None:
                notify(event.client, f"{doing} is not done yet. Press again afterwards.")
            return
        recordings, name = self._play.recordings, str(self._name.value)
        if recordings.under_way is None:
            self._play.activity.do(_BEGINNING, lambda: self._begin(name))
        else:
            self._play.activity.do(_ENDING, self._end)

    def _begin(self, name: str) -> None:
        recordings = self._play.recordings
        recordings.begin(name)
        begun = recordings.under_way
        as_asked = begun is None or begun.name.startswith(name.strip())
        self._renamed = "" if as_asked else f"; {name:.40} is no name of a file"

    def _end(self) -> None:
        self._line = ""
        self._line = self._play.end_recording()

    def _choose(self, name: str) -> "Future[None] | None":
        if name == _NONE:
            return None
        return self._play.activity.do(f"log {name:.60}", lambda: self._play.go_through_log(name))
