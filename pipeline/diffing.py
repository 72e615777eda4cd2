"""The first divergence of two files of one kind: two logs, or two controllers."""

from pathlib import Path

from pipeline.controller import Controller
from pipeline.controller_compare import ControllerDifference, first_difference
from recorders.errors import ReenactError
from recorders.reader import LogReader
from replay.compare import Divergence, first_divergence

_KINDS = (".mcap", ".npz")


def diff(a: Path, b: Path) -> Divergence | ControllerDifference | None:
    """Return where two logs (.mcap) or two controllers (.npz) first differ, None if they do not.

    `str()` of what is returned is one line for the user, `dataclasses.asdict` the same for JSON.

    Raises
    ------
    ReenactError
        If the files are not of one kind, or one of them cannot be read.
    """
    kinds = {path.suffix.lower() for path in (a, b)}
    if len(kinds) != 1 or not kinds <= set(_KINDS):
        raise ReenactError(f"expected two logs (.mcap) or two controllers (.npz), found {a.name} and {b.name}")
    if kinds == {".npz"}:
        return first_difference(Controller.load(a), Controller.load(b))
    return first_divergence(LogReader(a), LogReader(b))
