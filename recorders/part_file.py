"""The file of a log while it is written: `NAME.part`, one writer's alone, which gets its name when it is finished."""

import errno
import fcntl
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from recorders.errors import LogError
from recorders.nameless import NamelessFile, free_name


class PartFile:
    """`PATH.part`, locked while it is open, so that no two writers have the same one.

    Parameters
    ----------
    path : Path
        Where the file goes in the end.
    overwrite : bool
        Whether a file there may be replaced. A `.part` that nobody writes any more is what a crash left of another
        recording: it is kept in any case, as `.part.1` or the first free number.

    Attributes
    ----------
    part : Path
        The file as it is called while it is written.
    stream : binary file
        Takes what is written; buffered.

    Raises
    ------
    LogError
        If there is such a file already, or it cannot be made.
    """

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        self.path = path
        check_place(path, overwrite=overwrite)
        self.part = part_of(path)
        self._overwrite = overwrite
        try:
            descriptor = self._claim()
        except (OSError, ValueError) as error:  # ValueError: a name that no system can have
            raise self.error(error) from error
        self.stream: BinaryIO = os.fdopen(descriptor, "wb")

    def error(self, error: OSError | ValueError) -> LogError:
        """Return the error for a file that cannot be written."""
        return LogError(f"cannot write {self.part}: {getattr(error, 'strerror', None) or error}")

    def sync(self) -> None:
        """Have the disk take what the operating system has; raises OSError if it does not."""
        os.fsync(self.stream.fileno())

    def is_there(self) -> bool:
        """Whether the file still stands where it was made."""
        try:
            return os.path.samestat(self.part.stat(), os.fstat(self.stream.fileno()))
        except OSError:
            return False

    def put_back(self) -> LogError:
        """Bring a file that does not stand in its place back to it, if it was removed; returns what to tell the user.

        One that was moved, perhaps with its folder, stays where it is.
        """
        open_file = Path(f"/proc/self/fd/{self.stream.fileno()}")
        try:
            self.stream.flush()
            if os.fstat(self.stream.fileno()).st_nlink:
                return LogError(f"{self.part} was moved while it was written: the log is {open_file.readlink()}")
            self.part.parent.mkdir(parents=True, exist_ok=True)
            with open_file.open("rb") as source, self.part.open("xb") as copy:
                shutil.copyfileobj(source, copy)
        except OSError as error:
            return LogError(f"{self.part} was removed while it was written, and cannot be put back: {error.strerror}")
        return LogError(f"{self.part} was removed while it was written: what had been recorded is there again")

    def rewrite(self, copy: Callable[[BinaryIO, BinaryIO], None]) -> None:
        """Put a copy in the place of the file; raises OSError or what `copy` does, and the file is as before."""
        self.stream.flush()
        other = NamelessFile(self.part)
        try:
            _lock(other.stream.fileno())
            with self.part.open("rb") as source:
                copy(source, other.stream)
            other.stream.flush()
            other.replace()
        except BaseException:
            other.discard()
            raise
        self.stream.close()
        self.stream = other.stream

    def publish(self) -> None:
        """Give the file its name, once all of it is on the disk; raises OSError, or LogError if the name is taken."""
        self.stream.flush()
        self.sync()
        if self._overwrite:
            self.part.replace(self.path)
        else:
            self._take_name()
        _sync_folder(self.path.parent)
        self.stream.close()

    def close(self, *, keep: bool) -> None:
        """Leave the file as `.part`, or remove it; raises nothing, not even on a full disk."""
        if not keep and self.is_there():
            with suppress(OSError):
                self.part.unlink()
        with suppress(OSError):
            self.stream.close()

    def _claim(self) -> int:
        """Open the file and lock it; what another recording left there is set aside."""
        once = 0 if self._overwrite else os.O_EXCL
        try:
            descriptor = self._lock_part(once)
            if os.fstat(descriptor).st_size:
                try:
                    self._set_aside()
                finally:
                    os.close(descriptor)
                descriptor = self._lock_part(os.O_EXCL)
        except FileExistsError:
            raise LogError(
                f"{self.part} is left from an unfinished recording, or another writes it: `reenact recover` saves what "
                "is in it; move it away, or give --overwrite, which sets it aside"
            ) from None
        _sync_folder(self.part.parent)
        return descriptor

    def _lock_part(self, once: int) -> int:
        descriptor = os.open(self.part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | once, 0o666)
        try:
            _lock(descriptor)
            if not os.path.samestat(self.part.stat(), os.fstat(descriptor)):
                raise BlockingIOError  # its writer finished it between the two lines above
        except (BlockingIOError, FileNotFoundError):
            os.close(descriptor)
            raise LogError(f"{self.part} is being written by another recording: choose another name") from None
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    def _set_aside(self) -> None:
        """Give the `.part`, which is locked, a free name."""
        while True:
            with suppress(FileExistsError):
                _move(self.part, free_name(self.part, "."))
                return

    def _take_name(self) -> None:
        try:
            _move(self.part, self.path)
        except FileExistsError:
            raise LogError(f"{self.path} has come into being meanwhile: the finished log is {self.part}") from None


def part_of(path: Path) -> Path:
    """Return where a log is written until it is finished, and stays if it never is."""
    return path.with_name(f"{path.name}.part")


def check_place(path: Path, *, overwrite: bool) -> None:
    """Check that a log can be written as `path`, before the work that fills it; leaves nothing behind.

    Raises
    ------
    LogError
        If the folder is missing, `path` names something else than a file, or a file that may not be replaced.
    """
    try:
        if not path.name:
            raise _no_file(path)
        if not path.parent.is_dir():
            raise LogError(f"cannot write {path}: expected a folder {path.parent}, found none")
        _refuse_taken(path, overwrite=overwrite)
    except (OSError, ValueError) as error:  # ValueError: a name that no system can have
        raise LogError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from error


def _refuse_taken(path: Path, *, overwrite: bool) -> None:
    found = os.path.lexists(path)
    if found and not path.is_file():
        raise _no_file(path)
    if found and not overwrite:
        raise LogError(f"{path} exists: choose another name, or replace it with --overwrite")


def _no_file(path: Path) -> LogError:
    return LogError(f"cannot write {path}: expected the name of a file, found something else")


def _lock(descriptor: int) -> None:
    """Lock a file until it is closed, or its process ends in whatever way; raises BlockingIOError if another has it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL):  # a file system without locks
            raise


def _move(old: Path, new: Path) -> None:
    """Give a file a name that no other has; raises FileExistsError if one has it."""
    try:
        os.link(old, new)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links: an empty file takes the name, which only one writer can make
        new.open("xb").close()
        old.replace(new)
    else:
        old.unlink()


def _sync_folder(folder: Path) -> None:
    """Have the disk take the names in a folder, where the system lets us."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
