"""A log is a regular file: a pipe would be waited for, a device may have no end."""

from pathlib import Path
from stat import S_ISDIR, S_ISREG

from recorders.errors import LogError


def refuse_irregular(path: Path) -> None:
    """Raise LogError if something that is no regular file has this name; what is not there is left to who opens it."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    if S_ISDIR(mode):
        raise LogError(f"{path}: expected an MCAP file, found a directory")
    if not S_ISREG(mode):
        raise LogError(f"{path}: expected an MCAP file, found a pipe, a socket or a device")
