"""Recording that a viewer shows while it grows; a failure here is reported in one line and stops nothing else."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import rerun as rr
import rerun.blueprint as rrb

from recorders.errors import ReenactError
from recorders.rerun_scene.recording import Destination, open_recording
from recorders.rerun_scene.viewer import check_url, open_viewer
from recorders.text.wording import line_text

logger = logging.getLogger(__name__)


@contextmanager
def viewer(wanted: bool, url: str | None) -> Iterator["LiveView | None"]:
    """Open a window, or find the viewer at `url`, for what runs in the block; None if neither is wanted, or possible.

    Where it is not possible, that is logged.
    """
    view = None
    if wanted or url is not None:
        try:
            view = LiveView(check_url(url) if url is not None else open_viewer())
        except ReenactError as error:
            logger.warning(f"--view: {error}; going on without")
    try:
        yield view
    finally:
        if view is not None:
            view.close()


class LiveView:
    """A viewer that is there, and the recording that it shows.

    When it fails that is logged, and from then on nothing is sent.

    Parameters
    ----------
    url : str
        Where the viewer takes recordings.

    Attributes
    ----------
    url : str
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._stack = ExitStack()
        self._failed = False

    def attempt(self, action: Callable[[], object]) -> None:
        """Do something for the viewer alone."""
        if self._failed:
            return
        try:
            action()
        except Exception as error:
            self._failed = True
            logger.warning(f"--view: the viewer shows no more: {line_text(str(error)) or type(error).__name__}")

    def open(self, *, title: str, blueprint: rrb.Blueprint, kind: str) -> rr.RecordingStream:
        """Begin the recording; it is complete at `close`."""
        return self._stack.enter_context(
            open_recording(Destination(url=self.url), recording_id=None, title=title, blueprint=blueprint, kind=kind)
        )

    def close(self) -> None:
        """Send what is under way."""
        self.attempt(self._stack.close)
