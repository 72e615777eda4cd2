"""File names of a recording: as given, by the time at which it begins, or beside the remains of a crash."""

import logging
import os
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from recorders.errors import TakenError
from recorders.reading.parts import is_followed, parts_in
from recorders.writing.part_file import check_place, is_written, part_of

logger = logging.getLogger(__name__)

_UNNAMED = Path("session.mcap")


def recording_names(out: Path | None, *, splits: bool, overwrite: bool, now_ns: int) -> Iterator[Path]:
    """Yield the names that a recording may have, the best one first; the others in case that one is taken meanwhile.

    Files that a crash left are reported.

    Parameters
    ----------
    out : Path, optional
        As given; without it the name is `session_DATE_TIME.mcap` in the working directory.
    splits : bool
        Whether it goes to several files. Those that a crash cut short stay as they are: the name of the new ones
        has date and time in it.
    overwrite : bool
        Whether existing files may be replaced.
    now_ns : int
        The time [ns]; names have it in UTC, so that they sort, whatever a clock in the street shows.

    Raises
    ------
    TakenError
        If the name has a recording that came to its end, or one that is being written.
    LogError
        If a part to be replaced is no log.
    """
    if out is None:
        yield from _by_time(_UNNAMED, now_ns)
    elif splits and not overwrite and (taken := parts_in(out.parent, out.stem)):
        left = _cut_short(taken)
        for name in _by_time(out, now_ns):
            logger.warning(
                f"{left} was left by a recording that did not come to its end, and stays: `reenact recover` makes a "
                f"log of it. The parts of this one are called {name.stem}_*{name.suffix}"
            )
            yield name
    else:
        if splits and overwrite:
            for part in parts_in(out.parent, out.stem):
                if part.suffix != ".part":
                    check_place(part, overwrite=True)  # now, not when its turn comes
        yield out


def _by_time(like: Path, now_ns: int) -> Iterator[Path]:
    """Yield names that have the time in them, of this second and those after it, as far as they are free."""
    for second in count(now_ns // 10**9):
        stamp = time.strftime("%Y-%m-%d_%H-%M-%S", time.gmtime(second))
        path = like.with_name(f"{like.stem}_{stamp}{like.suffix}")
        if not (os.path.lexists(path) or os.path.lexists(part_of(path)) or parts_in(path.parent, path.stem)):
            yield path


def _cut_short(parts: list[Path]) -> Path:
    """Return the part with which a session ended early; raises TakenError if it did not."""
    for path in parts:
        if path.suffix == ".part" and is_written(path):
            raise TakenError(f"{path} is being written by another recording: choose another name")
    unfinished = [path for path in parts if path.suffix == ".part"]
    if unfinished or is_followed(parts[-1]):
        return unfinished[0] if unfinished else parts[-1]
    raise TakenError(f"{parts[0]} exists: choose another name, or --overwrite")
