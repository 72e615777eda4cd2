"""A folder for the files of a session, taken away at its end; of a session that was killed, by the next one."""

import fcntl
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

logger = logging.getLogger(__name__)

OWNER = "owner"
"""A file in it that its process holds locked until it ends, however that ends."""

_PREFIX = "reenact-"


@contextmanager
def session_folder() -> Iterator[Path]:
    """Make a folder for as long as the block runs, after those whose owners have ended were taken away."""
    remove_abandoned()
    directory = tempfile.TemporaryDirectory(prefix=_PREFIX, ignore_cleanup_errors=True)
    folder = Path(directory.name)
    unlocked = folder / f"{OWNER}.new"
    with unlocked.open("wb") as owner, directory:
        with suppress(OSError):  # where nothing can be locked, nothing is taken away either
            fcntl.flock(owner, fcntl.LOCK_EX)
            unlocked.rename(folder / OWNER)  # by its name it is locked from the beginning
        yield folder


def remove_abandoned() -> None:
    """Take away the folders of this user's sessions whose owners have ended; one that holds a log is named instead."""
    for folder in sorted(Path(tempfile.gettempdir()).glob(f"{_PREFIX}*")):
        try:
            if not _is_abandoned(folder):
                continue
        except OSError:  # somebody else's, or none of ours, or it is taken away just now
            continue
        if logs := sorted(folder.glob("*.mcap*")):
            logger.warning(f"{logs[0]}: a session that was killed was recording this; move or delete {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)


def _is_abandoned(folder: Path) -> bool:
    """Whether a folder is of a session whose owner has ended; raises OSError where it is none of this user's."""
    state = folder.lstat()
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.geteuid():
        return False
    descriptor = os.open(folder / OWNER, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(descriptor)
    return True
