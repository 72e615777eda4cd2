"""A file without a name while it is written, so that a process that is killed leaves nothing of it; and free names."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from recorders.files import disk


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
        self.stream: BinaryIO
        try:
            self.stream = disk.create_unnamed(near.parent)
        except OSError:
            self._name, self.stream = _create(near)

    def replace(self) -> None:
        """Take the place of the other file, all of it on the disk before; raises OSError if that fails."""
        self.stream.flush()
        disk.sync(self.stream)
        self._name = self._name or self._link()
        disk.rename(self._name, self._near)
        self._name = None

    def discard(self) -> None:
        """Close and remove the file; raises nothing."""
        with suppress(OSError):
            self.stream.close()
        if self._name is not None:
            with suppress(OSError):
                disk.unlink(self._name)

    def _link(self) -> Path:
        while True:
            name = free_name(self._near, ".tmp")
            with suppress(FileExistsError):
                disk.give_name(self.stream, name)
                return name


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
        file.replace()
        disk.sync_folder(path.parent)
    finally:
        file.discard()


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON for readers, as `write_whole` does; raises ValueError if a number is none."""
    write_whole(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def free_name(near: Path, ending: str) -> Path:
    """Return the first numbered name beside `near` that no file has just now; it may be taken before it is used."""
    names = (near.with_name(f"{near.name}{ending}{number}") for number in count(1))
    return next(path for path in names if not os.path.lexists(path))


def _create(near: Path) -> tuple[Path, BinaryIO]:
    while True:
        path = free_name(near, ".tmp")
        with suppress(FileExistsError):
            return path, disk.create(path)
