"""The first divergence of two files of one kind: two logs, or two controllers."""

from pathlib import Path

from pipeline.controller import Controller, is_controller
from pipeline.controller_compare import ControllerDifference, first_difference
from recorders.errors import ReenactError
from recorders.parts import is_log
from recorders.session_reader import open_log
from replay.compare import Divergence, first_divergence


def diff(a: Path, b: Path) -> Divergence | ControllerDifference | None:
    """Return where two recordings or two controllers first differ, None if they do not.

    `str()` of what is returned is one line for the user, `dataclasses.asdict` the same for JSON.

    Raises
    ------
    ReenactError
        If the files are not of one kind, or one of them cannot be read.
    """
    if is_log(a) and is_log(b):
        return first_divergence(open_log(a), open_log(b))
    if is_controller(a) and is_controller(b):
        return first_difference(Controller.load(a), Controller.load(b))
    raise ReenactError(f"expected two logs (.mcap) or two controllers (.npz), found {a.name} and {b.name}")
