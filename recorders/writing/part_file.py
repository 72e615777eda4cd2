"""The file of a log while it is written: `NAME.part`, one writer's alone, which gets its name when it is finished."""

import errno
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
from recorders.files import disk
from recorders.files.anonymous_file import AnonymousFile
from recorders.files.regular_file import begins_with
from recorders.mcap_format.records import MAGIC

logger = logging.getLogger(__name__)


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
            self.stream = self._claim()
        except (OSError, ValueError) as error:  # ValueError: a name that no system can have
            raise self.error(error) from error

    def error(self, error: OSError | ValueError) -> LogError:
        """Return the error for a file that cannot be written."""
        return LogError(f"cannot write {self.part}: {getattr(error, 'strerror', None) or error}")

    def sync(self) -> None:
        """Have the disk take what the operating system has; raises OSError if it does not."""
        disk.sync(self.stream)

    def is_there(self) -> bool:
        """Whether the file is still where it was created; raises OSError if that cannot be found out."""
        return _is_at(self.part, self.stream)

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
            disk.make_folders(self.part.parent)
            with disk.open_to_read(self._open_file) as source, disk.create(self.part) as copy:
                shutil.copyfileobj(source, copy)
                copy.flush()
                disk.sync(copy)
            disk.sync_folder(self.part.parent)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            return LogError(f"{self.part} was removed while it was written, and cannot be put back: {why}")
        return LogError(f"{self.part} was removed while it was written: what had been recorded is there again")

    def rewrite(self, copy: Callable[[BinaryIO, BinaryIO], None]) -> None:
        """Put a copy in the place of the file, and then on the disk.

        It raises OSError or what `copy` does, and the file is as before.
        """
        self.stream.flush()
        other = AnonymousFile(self.part)
        try:
            disk.lock(other.stream)
            with disk.open_to_read(self.part) as source:
                copy(source, other.stream)
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
            If the name is taken, or the disk reports a failure after the file had its name.
        """
        self.stream.flush()
        self.sync()
        try:
            if self._overwrite:
                disk.rename(self.part, self.path)
                disk.sync_folder(self.path.parent)
            else:
                self._take_name()
            self.stream.close()
        except OSError as error:
            if not self._has_name():
                raise
            raise LogError(f"{self.path} is whole, but the disk failed after that: {error.strerror}") from error

    def close(self, *, keep: bool) -> None:
        """Leave the file as `.part`, or remove it; raises nothing, not even on a full disk."""
        with suppress(OSError, ValueError):  # ValueError: it is closed
            if not keep and self.is_there():
                disk.unlink(self.part)
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

    def _has_name(self) -> bool:
        with suppress(OSError, ValueError):  # ValueError: it is closed, after all else
            return _is_at(self.path, self.stream)
        return self.stream.closed

    def _claim(self) -> BinaryIO:
        """Make the file and lock it."""
        while True:
            try:
                stream = disk.create(self.part)
            except FileExistsError:
                self._clear()
                continue
            try:
                self._lock_part(stream)
                disk.sync_folder(self.part.parent)
            except BaseException:
                with suppress(OSError):
                    if _is_at(self.part, stream):
                        disk.unlink(self.part)
                stream.close()
                raise
            return stream

    def _clear(self) -> None:
        """Take a file that another recording left out of the way, unless it is written still."""
        try:
            left = disk.open_to_lock(self.part)
        except FileNotFoundError:
            return  # it is gone just now
        except OSError as error:
            raise (_no_file(self.part) if error.errno == errno.ELOOP else error) from None
        with left:
            found = os.fstat(left.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise _no_file(self.part)
            if not self._lock_part(left) and not self._overwrite:
                raise LogError(
                    f"{self.part} is left from an unfinished recording, or another writes it, which this file system "
                    "cannot show: move it away, or give --overwrite, which sets it aside"
                )
            self._set_aside(os.fstat(left.fileno()).st_size)

    def _lock_part(self, file: BinaryIO) -> bool:
        """Lock the file for this writer alone; False on a file system without locks.

        Raises
        ------
        LogError
            If another has it.
        """
        try:
            locked = disk.lock(file)
            if not os.path.samestat(os.lstat(self.part), os.fstat(file.fileno())):
                raise BlockingIOError  # another was faster between opening and locking
        except (BlockingIOError, FileNotFoundError):
            raise TakenError(f"{self.part} is being written by another recording: choose another name") from None
        return locked

    def _set_aside(self, size: int) -> None:
        """Give the `.part` that was left, and is locked, a free name; one that is empty, or has the other too, goes."""
        with suppress(FileNotFoundError):
            size = 0 if self.part.samefile(self.path) else size
        if not size:
            disk.unlink(self.part)
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
    with disk.open_to_lock(part) as file:
        try:
            disk.lock(file)
        except BlockingIOError:
            return True
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


def _is_at(path: Path, stream: BinaryIO) -> bool:
    """Whether an open file has a name; raises OSError if that cannot be found out."""
    try:
        found = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return os.path.samestat(found, os.fstat(stream.fileno()))


def _move(old: Path, new: Path) -> None:
    """Give a file a name that no other has, and take the old one away once the disk has that.

    The disk need not have the latter: so it may have both names after a crash, but never none. Raises FileExistsError
    if another has the name.
    """
    try:
        disk.link(old, new)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links: an empty file takes the name, which only one writer can make
        disk.create(new).close()
        try:
            disk.rename(old, new)
        except OSError:
            disk.unlink(new)
            raise
        disk.sync_folder(new.parent)
    else:
        disk.sync_folder(new.parent)
        disk.unlink(old)
