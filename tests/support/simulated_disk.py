"""A disk of which one operation fails, or at which the process or the power goes, in the place of the real one.

It takes the place of the functions of `recorders.files.disk`. Every operation is done on a real folder, so that whoever
reads it sees what the operating system would show, and is written down in a journal, from which it is found out what a
crash leaves.
"""

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

from disk_journal import File, Journal

from recorders.files import disk as real

ERRORS = ("EIO", "EINTR", "ENOSPC", "EDQUOT", "EROFS", "short")
CRASHES = ("crash before", "crash within", "crash after")
KINDS = (*ERRORS, *CRASHES)

_FLAGS = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
_NEED_ROOM = ("create", "create_unnamed", "write", "give_name", "link", "make_folder")
_CHANGE = (*_NEED_ROOM, "rename", "unlink", "remove_folder")
_LASTING = {"ENOSPC": _NEED_ROOM, "EDQUOT": _NEED_ROOM, "EROFS": _CHANGE}


class Crash(BaseException):
    """The process ends here: nothing that handles errors takes it."""


@dataclass(frozen=True)
class Fault:
    """The operation that fails.

    Attributes
    ----------
    at : int
        Which one, counted from 0; a negative one: none.
    kind : str
        One of `KINDS`. `ENOSPC`, `EDQUOT` and `EROFS` last from then on; `ENOSPC` takes half of a write first, as
        `short` and `crash within` do.
    """

    at: int = -1
    kind: str = "EIO"


class SimulatedDisk:
    """A disk under one folder.

    Parameters
    ----------
    root : Path
        A real folder; what is in it is on the disk.
    fault : Fault
        The operation that fails.

    Attributes
    ----------
    operations : list of str
        What was asked so far.
    failed, crashed : bool
        Whether the fault was met, and whether nothing changes any more.
    journal : Journal
        What was done; says what a crash leaves.
    """

    def __init__(self, root: Path, fault: Fault | None = None) -> None:
        self.operations: list[str] = []
        self.failed = False
        self.crashed = False
        self.journal = Journal(root)
        self._fault = fault or Fault()
        self._open: list[_RawFile] = []

    @contextmanager
    def installed(self) -> Iterator[Self]:
        """Stand in the place of the operating system's disk, as long as the block lasts."""
        for name in _REAL:
            setattr(real, name, getattr(self, name))
        try:
            yield self
        finally:
            for name, function in _REAL.items():
                setattr(real, name, function)

    def open_files(self) -> int:
        """Return how many files are open."""
        return sum(not file.closed for file in self._open)

    def crash(self) -> None:
        """End the process: nothing changes any more, its files are closed, and whatever is asked raises Crash."""
        self.crashed = True
        for file in self._open:
            file.close()

    # In the place of the functions of `recorders.files.disk`; what they do stands there.

    def create(self, path: Path) -> BinaryIO:
        file = File()
        with self.operation("create"):
            stream = self._opened(os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o666), "wb", file)
            self.journal.name(path, file)
        return io.BufferedWriter(stream)

    def create_unnamed(self, folder: Path) -> BinaryIO:
        with self.operation("create_unnamed"):
            stream = self._opened(os.open(folder, os.O_RDWR | os.O_TMPFILE | os.O_CLOEXEC, 0o666), "wb", File())
        return io.BufferedWriter(stream)

    def open_to_read(self, path: Path) -> BinaryIO:
        with self.operation("open_to_read"):
            stream = self._opened(os.open(path, os.O_RDONLY | os.O_CLOEXEC), "rb")
        return io.BufferedReader(stream)

    def open_to_lock(self, path: Path) -> Any:
        with self.operation("open_to_lock"):
            return self._opened(os.open(path, _FLAGS | os.O_NONBLOCK), "rb+")

    def lock(self, file: BinaryIO) -> Any:
        with self.operation("lock"):
            return _REAL["lock"](file)

    @contextmanager
    def locked_folder(self, path: Path) -> Iterator[bool]:
        with self.operation("lock"):
            pass
        with _REAL["locked_folder"](path) as is_locked:
            yield is_locked

    def read_at(self, file: BinaryIO, size: int, place: int) -> bytes:
        with self.operation("read_at"):
            return os.pread(file.fileno(), size, place)

    def sync(self, file: BinaryIO) -> None:
        written = _file_of(file)
        try:
            with self.operation("sync"):
                written.sync()
        except OSError:
            written.fail_sync()
            raise

    def sync_folder(self, folder: Path) -> None:
        with self.operation("sync_folder"):
            self.journal.sync_folder(folder)

    def give_name(self, file: BinaryIO, path: Path) -> None:
        with self.operation("give_name"):
            _REAL["give_name"](file, path)
            self.journal.name(path, _file_of(file))

    def link(self, old: Path, new: Path) -> None:
        with self.operation("link"):
            _REAL["link"](old, new)
            self.journal.name(new, self.journal.find(old))

    def rename(self, old: Path, new: Path) -> None:
        with self.operation("rename"):
            _REAL["rename"](old, new)
            self.journal.rename(old, new)

    def unlink(self, path: Path) -> None:
        with self.operation("unlink"):
            _REAL["unlink"](path)
            self.journal.name(path, None)

    def make_folder(self, path: Path) -> None:
        with self.operation("make_folder"):
            _REAL["make_folder"](path)
            self.journal.make_folder(path)

    def remove_folder(self, path: Path) -> None:
        with self.operation("remove_folder"):
            _REAL["remove_folder"](path)
            self.journal.name(path, None)

    # What happens to an operation.

    @contextmanager
    def operation(self, name: str) -> Iterator[None]:
        """Count an operation, which the block does, unless it fails; raises OSError and Crash."""
        number = len(self.operations)
        self.begin(name)
        yield
        self.end(number)

    def begin(self, name: str) -> bool:
        """Count an operation, and raise what comes before it; returns whether it is cut in half."""
        if self.crashed:
            raise Crash
        self.operations.append(name)
        number, fault = len(self.operations) - 1, self._fault
        if fault.at < 0 or number < fault.at:
            return False
        if number > fault.at:
            if name in _LASTING.get(fault.kind, ()):
                raise _error(fault.kind)
            return False
        return self._fail(name)

    def end(self, number: int, *, is_half: bool = False) -> None:
        """Raise what comes after the operation of this number, or in the middle of it."""
        if number == self._fault.at and self._fault.kind == ("crash within" if is_half else "crash after"):
            self.crash()
            raise Crash

    def _fail(self, name: str) -> bool:
        kind = self._fault.kind
        is_half = name == "write" and kind in ("short", "crash within", "ENOSPC")
        self.failed = is_half or kind not in ("short", "crash within")
        if kind == "crash before":
            self.crash()
            raise Crash
        harmless = kind in ("short", "crash within", "crash after") or (kind == "EROFS" and name not in _CHANGE)
        if not (is_half or harmless):
            raise _error(kind)
        return is_half

    def _opened(self, descriptor: int, mode: str, file: File | None = None) -> "_RawFile":
        opened = _RawFile(self, descriptor, mode, file)
        self._open.append(opened)
        return opened


class _RawFile(io.FileIO):
    """An open file of the disk: reading, writing and closing it are operations."""

    def __init__(self, disk: SimulatedDisk, descriptor: int, mode: str, file: File | None) -> None:
        super().__init__(descriptor, mode)
        self.file = file
        self._disk = disk

    def write(self, data: Any) -> int:
        if self._disk.crashed:
            return len(data)  # nobody knows any more
        assert self.file is not None
        number = len(self._disk.operations)
        is_half = self._disk.begin("write")
        taken = bytes(data)[: max(1, len(data) // 2)] if is_half else bytes(data)
        self.file.write(super().tell(), taken)
        written = super().write(taken)
        assert written == len(taken)
        self._disk.end(number, is_half=is_half)
        return written

    def readinto(self, buffer: Any) -> int:
        with self._disk.operation("read"):
            return super().readinto(buffer)

    def readall(self) -> bytes:
        with self._disk.operation("read"):
            return super().readall()

    def close(self) -> None:
        """Close, and only then fail: a descriptor is gone whatever `close` returns."""
        was_open = not self.closed
        super().close()
        if was_open and not self._disk.crashed:
            with self._disk.operation("close"):
                pass


_REAL: dict[str, Callable[..., Any]] = {
    name: function for name, function in vars(real).items() if callable(function) and name in vars(SimulatedDisk)
}


def _error(kind: str) -> OSError:
    code = getattr(errno, kind)
    return OSError(code, os.strerror(code))


def _file_of(stream: Any) -> File:
    file = stream.raw.file
    assert isinstance(file, File)
    return file
