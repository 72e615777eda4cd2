"""The key that the ends of a stream share: a file of `--key`, or the user's own, made when it is first needed."""

import os
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

from recorders.errors import ConfigError
from recorders.protocol.seals.authentication import KEY_BYTES

_HEX = re.compile(rb"\s*([0-9a-fA-F]{%d})\s*" % (2 * KEY_BYTES))
_MAX_FILE = 1024
_EXPECTED = f"{2 * KEY_BYTES} hexadecimal digits"


def shared_key(path: Path | None = None) -> bytes:
    """Return the key of a file, or of the user's own file, which is made if it is not there yet.

    Parameters
    ----------
    path : Path, optional
        As `--key` names it; if left out, the user's own.

    Raises
    ------
    ConfigError
        If the file is not there, is a link, another user's or readable by others, holds no key, or cannot be made.
    """
    return read_key(path) if path is not None else _own_key()


def read_key(path: Path) -> bytes:
    """Return the key of a file that this user alone can read; raises ConfigError if it is not one."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise ConfigError(f"{path}: expected a regular file with the key of streams; give another with --key")
            if found.st_uid != os.geteuid() or found.st_mode & 0o077:
                raise ConfigError(
                    f"{path}: expected a key that is yours and that nobody else may read, found owner {found.st_uid} "
                    f"and mode {stat.S_IMODE(found.st_mode):03o}: chmod 600 it, or give another with --key"
                )
            text = file.read(_MAX_FILE)
    except (OSError, ValueError) as error:  # the latter of a name with a NUL in it
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(
            f"{path}: expected a file, no link, with a key of streams ({reason}); give another with --key"
        ) from error
    key = _HEX.fullmatch(text)
    if key is None:
        raise ConfigError(f"{path}: expected {_EXPECTED} as the key of streams; give another with --key")
    return bytes.fromhex(key[1].decode())


def _own_key() -> bytes:
    folder = _own_folder()
    path = folder / "stream.key"
    if not path.is_symlink() and not path.exists():
        _make(path)
    return read_key(path)


def _own_folder() -> Path:
    """Return the private folder of this user's keys: at run time, else beside the user's other state."""
    for parent in _runtime_folders():
        if _is_private(parent):
            return _private_folder(parent / "reenact", parent)
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        parent = state if state.is_absolute() else Path.home() / ".local" / "state"
        parent.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:
        raise _no_folder(str(error)) from error
    return _private_folder(parent / "reenact", parent)


def _runtime_folders() -> Iterator[Path]:
    named = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    if named.is_absolute():
        yield named
    yield Path(f"/run/user/{os.geteuid()}")


def _private_folder(folder: Path, parent: Path) -> Path:
    """Return a private folder, made if it is not there."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise _no_folder(f"{parent}: {error.strerror}") from error
    if not _is_private(folder):
        raise _no_folder(f"{folder} is a link, another user's, or open to others")
    return folder


def _is_private(folder: Path) -> bool:
    """Whether a folder is this user's, and nobody else can put a file there."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077


def _make(path: Path) -> None:
    """Make a key, whole or not at all; whoever was faster wins."""
    new = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600), "w") as file:
            file.write(secrets.token_hex(KEY_BYTES) + "\n")
        try:
            os.link(new, path)
        except FileExistsError:
            pass
        finally:
            new.unlink()
    except OSError as error:
        raise _no_folder(f"{path.parent}: {error.strerror}") from error


def _no_folder(found: str) -> ConfigError:
    return ConfigError(
        f"no private folder for the key of streams ({found}): name a file of yours alone with --key, {_EXPECTED}"
    )
