"""The calls of the operating system by which files are written, so that a disk that fails can be put in their place.

They are called as `disk.rename(...)`, never imported one by one, and raise OSError.

What holds after a crash of the process (P) or of the machine (M), in whatever order the disk took what was not synced:

- A log while it is written: its name `NAME.part` once it is begun (M); a message 100 ms after it came, or with the 64th
  (P), and with the next sync after that, of which one begins a second after the last has ended (M).
- A log that is finished, one of `convert` or `recover`: all of it has the name (M). Until then the name is nobody's, or
  that of the whole log that is replaced. `NAME.part` may be a second name of a finished log. What another recording
  left as `.part` has a name throughout.
- A log in parts: the same of each part. Where `convert --overwrite` is cut short, some are new and some are old.
- A controller, a checkpoint, a report, a robot's file: the old one or the new one, whole; the new one as soon as
  `write_whole` returns (M).
- A folder of tables or a golden case: all of it has the name, or nothing. While a case takes the place of another, the
  latter may be called `.CASE.replaced`; the next `golden add` puts it back.

A killed process may leave a file `NAME.tmp1`, which nothing needs. A folder in the making that it leaves is removed
by the next one of that name.
"""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_FLAGS = os.O_RDWR | os.O_CLOEXEC
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
_OPEN_FILES = "/proc/self/fd"  # gives a file without a name one
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)
_NO_SYNC_OF_FOLDERS = (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS)


def create(path: Path) -> BinaryIO:
    """Make a new file, to be written to; raises FileExistsError if the name is taken, by a link too."""
    return os.fdopen(os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666), "wb")


def create_unnamed(folder: Path) -> BinaryIO:
    """Make a new file without a name, which is gone when it is closed; not every file system has them."""
    Path(_OPEN_FILES).stat()
    return os.fdopen(os.open(folder, _FLAGS | os.O_TMPFILE, 0o666), "wb")


def open_to_read(path: Path) -> BinaryIO:
    """Open a file to read it."""
    return path.open("rb")


def open_to_lock(path: Path) -> BinaryIO:
    """Open a file as it is, unbuffered; neither is a link followed nor a pipe waited for."""
    return os.fdopen(os.open(path, _FLAGS | os.O_NOFOLLOW | os.O_NONBLOCK), "rb+", buffering=0)


def lock(file: BinaryIO) -> bool:
    """Lock a file until it is closed, or its process ends in whatever way.

    Returns whether the file system has locks; raises BlockingIOError if another has this one.
    """
    return _lock(file.fileno())


@contextmanager
def locked_folder(path: Path) -> Iterator[bool]:
    """Lock a folder as long as the block lasts; yields and raises as `lock` returns and raises."""
    descriptor = os.open(path, _FOLDER)
    try:
        yield _lock(descriptor)
    finally:
        os.close(descriptor)


def read_at(file: BinaryIO, size: int, place: int) -> bytes:
    """Return bytes of a file that is being written, which it has been given so far."""
    return os.pread(file.fileno(), size, place)


def sync(file: BinaryIO) -> None:
    """Have the disk take what the operating system has of a file.

    After a failure nothing that was not synced may be relied on, whatever a later call returns.
    """
    os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Have the disk take the names in a folder, where the file system can and the folder may be read."""
    try:
        descriptor = os.open(folder, _FOLDER)
    except PermissionError:
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_SYNC_OF_FOLDERS:
            raise
    finally:
        os.close(descriptor)


def give_name(file: BinaryIO, path: Path) -> None:
    """Give a file without a name one; raises FileExistsError if it is taken."""
    folder = os.open(path.parent, _FOLDER)
    try:
        # Only with a folder does Python make the call that follows the link to the open file.
        os.link(f"{_OPEN_FILES}/{file.fileno()}", path.name, src_dir_fd=folder, dst_dir_fd=folder)
    finally:
        os.close(folder)


def link(old: Path, new: Path) -> None:
    """Give a file a second name; raises FileExistsError if it is taken."""
    new.hardlink_to(old)


def rename(old: Path, new: Path) -> None:
    """Give a file or folder another name, in place of whatever has it; a folder takes that of an empty one only."""
    old.replace(new)


def unlink(path: Path) -> None:
    """Take a name away."""
    path.unlink()


def make_folder(path: Path) -> None:
    """Make a folder; raises FileExistsError if the name is taken."""
    path.mkdir()


def remove_folder(path: Path) -> None:
    """Take an empty folder away."""
    path.rmdir()


def make_folders(path: Path) -> None:
    """Make a folder, and those above it, unless they are there."""
    if not path.is_dir():
        make_folders(path.parent)
        with suppress(FileExistsError):
            make_folder(path)
        sync_folder(path.parent)


def remove_tree(folder: Path) -> None:
    """Take a folder away with what is in it, as far as that can be done; raises nothing."""
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            if path.is_dir() and not path.is_symlink():
                remove_tree(path)
            else:
                unlink(path)
        remove_folder(folder)


def _lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        return False
    return True
