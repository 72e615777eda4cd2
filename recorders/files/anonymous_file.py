"""A file without a name while it is written, so that a process that is killed leaves nothing of it; and free names."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from recorders.files.whole_files import sync_folder

_FLAGS = os.O_RDWR | os.O_CLOEXEC
_OPEN_FILES = "/proc/self/fd"  # gives a file without a name one


class AnonymousFile:
    """A new file in a folder, which gets its name when it is whole.

    On a file system that has no files without a name it has one of the free names, and a killed process leaves it.

    Parameters
    ----------
    near : Path
        The file whose place it may take.

    Attributes
    ----------
    stream : binary file
        Takes what is written; buffered.

    Raises
    ------
    OSError
        If it cannot be made.
    """

    def __init__(self, near: Path) -> None:
        self._near = near
        self._name: Path | None = None
        try:
            Path(_OPEN_FILES).stat()
            descriptor = os.open(near.parent, _FLAGS | os.O_TMPFILE, 0o666)
        except OSError:
            self._name, descriptor = _create(near)
        self.stream: BinaryIO = os.fdopen(descriptor, "wb")

    def replace(self) -> None:
        """Take the place of the other file; raises OSError if that fails."""
        self._name = self._name or self._link()
        self._name.replace(self._near)
        self._name = None

    def discard(self) -> None:
        """Close and remove the file; raises nothing."""
        with suppress(OSError):
            self.stream.close()
        if self._name is not None:
            with suppress(OSError):
                self._name.unlink()

    def _link(self) -> Path:
        descriptor = self.stream.fileno()
        folder = os.open(self._near.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            while True:
                name = free_name(self._near, ".tmp")
                with suppress(FileExistsError):
                    # Only with a folder does Python make the call that follows the link to the open file.
                    os.link(f"{_OPEN_FILES}/{descriptor}", name.name, src_dir_fd=folder, dst_dir_fd=folder)
                    return name
        finally:
            os.close(folder)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that has its name once it is whole, both on the disk; a link of that name is replaced, not followed.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    file = AnonymousFile(path)
    try:
        file.stream.write(data)
        file.stream.flush()
        os.fsync(file.stream.fileno())
        file.replace()
        sync_folder(path.parent)
    finally:
        file.discard()


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON for readers, as `write_whole` does; raises ValueError if a number is none."""
    write_whole(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def free_name(near: Path, ending: str) -> Path:
    """Return the first numbered name beside `near` that no file has just now; it may be taken before it is used."""
    names = (near.with_name(f"{near.name}{ending}{number}") for number in count(1))
    return next(path for path in names if not os.path.lexists(path))


def _create(near: Path) -> tuple[Path, int]:
    while True:
        path = free_name(near, ".tmp")
        with suppress(FileExistsError):
            return path, os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o666)
