"""The file of a log while it is written: `NAME.part`, one writer's alone, which gets its name when it is finished."""

import errno
import fcntl
import logging
import os
import re
import shutil
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from recorders.errors import LogError, TakenError
from recorders.files.anonymous_file import AnonymousFile
from recorders.files.regular_file import begins_with
from recorders.files.whole_files import sync_folder
from recorders.mcap_format.records import MAGIC

logger = logging.getLogger(__name__)

_FLAGS = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW


class PartFile:
    """`PATH.part`, locked while it is open, so that no two writers have the same one.

    It is always a new file. One of that name that nobody writes any more is what a crash left of another recording: it
    is set aside, as `PATH.part.0001` and so on, the latest last, and reported.

    Parameters
    ----------
    path : Path
        Where the file goes in the end.
    overwrite : bool
        Whether a file there may be replaced.

    Attributes
    ----------
    part : Path
        The file as it is called while it is written.
    stream : binary file
        Takes what is written; buffered.

    Raises
    ------
    LogError
        If another writes such a file, or it cannot be made.
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
        """Whether the file is still where it was created; raises OSError if that cannot be found out."""
        try:
            found = self.part.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return False
        return os.path.samestat(found, os.fstat(self.stream.fileno()))

    def failure(self, error: OSError | ValueError) -> LogError:
        """Return the error for a file that could not be written on, which is put back if it is not there."""
        with suppress(OSError, ValueError):  # ValueError: it is closed
            if not self.is_there():
                return self.put_back()
        return self.error(error)

    def put_back(self) -> LogError:
        """Bring a file that is not in its place back to it, if it was removed; returns a note for the user.

        One that was moved, perhaps with its folder or with its whole file system, stays where it is.
        """
        try:
            if os.fstat(self.stream.fileno()).st_nlink:
                return LogError(self._moved())
            self.stream.flush()
            self.part.parent.mkdir(parents=True, exist_ok=True)
            with self._open_file.open("rb") as source, self.part.open("xb") as copy:
                shutil.copyfileobj(source, copy)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            return LogError(f"{self.part} was removed while it was written, and cannot be put back: {why}")
        return LogError(f"{self.part} was removed while it was written: what had been recorded is there again")

    def rewrite(self, copy: Callable[[BinaryIO, BinaryIO], None]) -> None:
        """Put a copy in the place of the file; raises OSError or what `copy` does, and the file is as before."""
        self.stream.flush()
        other = AnonymousFile(self.part)
        try:
            _lock(other.stream.fileno())
            with self.part.open("rb") as source:
                copy(source, other.stream)
            other.stream.flush()
            other.replace()
        except BaseException:
            other.discard()
            raise
        old, self.stream = self.stream, other.stream
        with suppress(OSError):  # nobody needs the old one any more
            old.close()

    def publish(self) -> None:
        """Give the file its name, once all of it is on the disk.

        Raises
        ------
        OSError
            If that fails.
        LogError
            If the name is taken, or the disk reports a failure after all was done.
        """
        self.stream.flush()
        self.sync()
        if self._overwrite:
            self.part.replace(self.path)
        else:
            self._take_name()
        with suppress(OSError):  # where the system lets us
            sync_folder(self.path.parent)
        try:
            self.stream.close()
        except OSError as error:
            raise LogError(f"{self.path} is whole and on the disk, but closing it failed: {error.strerror}") from error

    def close(self, *, keep: bool) -> None:
        """Leave the file as `.part`, or remove it; raises nothing, not even on a full disk."""
        with suppress(OSError, ValueError):  # ValueError: it is closed
            if not keep and self.is_there():
                self.part.unlink()
        with suppress(OSError):
            self.stream.close()

    @property
    def _open_file(self) -> Path:
        """A path to the open file, whatever its name has become."""
        return Path(f"/proc/self/fd/{self.stream.fileno()}")

    def _moved(self) -> str:
        """Return the note on a file that has a name, but another one."""
        place = self._open_file.readlink()
        with suppress(OSError):
            if place.samefile(self._open_file):
                return f"{self.part} was moved while it was written: the log is {place}"
        return (
            f"{self.part} was taken away while it was written, with its file system: what was recorded until then is "
            "there, and `reenact recover` saves it once that is mounted again"
        )

    def _claim(self) -> int:
        """Make the file and lock it; returns its descriptor."""
        while True:
            try:
                descriptor = os.open(self.part, _FLAGS | os.O_CREAT | os.O_EXCL, 0o666)
            except FileExistsError:
                self._clear()
            else:
                try:
                    self._lock_part(descriptor)
                except BaseException:
                    os.close(descriptor)
                    raise
                with suppress(OSError):  # where the system lets us
                    sync_folder(self.part.parent)
                return descriptor

    def _clear(self) -> None:
        """Take a file that another recording left out of the way, unless it is written still."""
        try:
            descriptor = os.open(self.part, _FLAGS | os.O_NONBLOCK)
        except FileNotFoundError:
            return  # it is gone just now
        except OSError as error:
            raise (_no_file(self.part) if error.errno == errno.ELOOP else error) from None
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise _no_file(self.part)
            if not self._lock_part(descriptor) and not self._overwrite:
                raise LogError(
                    f"{self.part} is left from an unfinished recording, or another writes it, which this file system "
                    "cannot show: move it away, or give --overwrite, which sets it aside"
                )
            self._set_aside(os.fstat(descriptor).st_size)
        finally:
            os.close(descriptor)

    def _lock_part(self, descriptor: int) -> bool:
        """Lock the file for this writer alone; False on a file system without locks.

        Raises
        ------
        LogError
            If another has it.
        """
        try:
            locked = _lock(descriptor)
            if not os.path.samestat(os.lstat(self.part), os.fstat(descriptor)):
                raise BlockingIOError  # another was faster between opening and locking
        except (BlockingIOError, FileNotFoundError):
            raise TakenError(f"{self.part} is being written by another recording: choose another name") from None
        return locked

    def _set_aside(self, size: int) -> None:
        """Give the `.part` that was left, and is locked, a free name; remove one that is empty."""
        if not size:
            self.part.unlink()
            return
        while True:
            aside = _name_aside(self.part)
            with suppress(FileExistsError):
                _move(self.part, aside)
                break
        logger.warning(
            f"{self.part} was left by a recording that did not come to its end; it is now {aside}, and "
            "`reenact recover` makes a log of it"
        )

    def _take_name(self) -> None:
        try:
            _move(self.part, self.path)
        except FileExistsError:
            raise LogError(f"{self.path} has come into being meanwhile: the finished log is {self.part}") from None


def part_of(path: Path) -> Path:
    """Return where a log is written until it is finished, and stays if it never is."""
    return path.with_name(f"{path.name}.part")


def is_written(part: Path) -> bool:
    """Whether another process writes a file, by its lock; raises OSError if it cannot be opened."""
    descriptor = os.open(part, _FLAGS)
    try:
        _lock(descriptor)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def check_place(path: Path, *, overwrite: bool) -> None:
    """Check that a log can be written as `path`, before the work that fills it; leaves nothing behind.

    A log may, with `overwrite`, take the place of another one and of an empty file; of nothing else.

    Raises
    ------
    LogError
        If the folder is missing, or `path` names something else than a file, or a file that is no log or may not be
        replaced.
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
        raise TakenError(f"{path} exists: choose another name, or replace it with --overwrite")
    # Of a link nothing is lost: it is replaced, and what it points to stays.
    if found and not path.is_symlink() and path.stat().st_size and not begins_with(path, MAGIC):
        raise LogError(
            f"cannot write {path}: there is a file that is no log, which stays as it is; choose another name"
        )


def _no_file(path: Path) -> LogError:
    return LogError(f"cannot write {path}: expected the name of a file, found something else")


def _name_aside(part: Path) -> Path:
    """Return a name that sorts after those of what was set aside before."""
    earlier = re.compile(re.escape(part.name) + r"\.(\d{4,9})")
    found = (earlier.fullmatch(path.name) for path in part.parent.iterdir())
    last = max((int(match[1]) for match in found if match), default=0)
    return part.with_name(f"{part.name}.{last + 1:04d}")


def _lock(descriptor: int) -> bool:
    """Lock a file until it is closed, or its process ends in whatever way.

    Returns whether the file system has locks; raises BlockingIOError if another has this one.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL):
            raise
        return False
    return True


def _move(old: Path, new: Path) -> None:
    """Give a file a name that no other has; raises FileExistsError if one has it."""
    try:
        os.link(old, new)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links: an empty file takes the name, which only one writer can make
        new.open("xb").close()
        try:
            old.replace(new)
        except OSError:
            new.unlink()
            raise
    else:
        old.unlink()
