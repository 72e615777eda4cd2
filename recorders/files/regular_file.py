"""A file that the user names is a regular file: a pipe would be waited for, a device may have no end."""

from pathlib import Path
from stat import S_ISDIR, S_ISREG

from recorders.errors import LogError, ReenactError, unreadable


def require_regular_file(path: Path, *, expected: str = "an MCAP file", error: type[ReenactError] = LogError) -> None:
    """Raise `error` if something that is no regular file has this name.

    What is not there is left to who opens it.

    Parameters
    ----------
    path : Path
        The name.
    expected : str
        What the file should be, for the message.
    error : type of ReenactError
        What is raised.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    if S_ISDIR(mode):
        raise error(f"{path}: expected {expected}, found a directory")
    if not S_ISREG(mode):
        raise error(f"{path}: expected {expected}, found a pipe, a socket or a device")


def begins_with(path: Path, magic: bytes) -> bool:
    """Whether a file begins with these bytes, whatever it is called; raises LogError if it cannot be read."""
    require_regular_file(path, expected="a file")
    try:
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
