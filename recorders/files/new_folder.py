"""A folder of files that gets its name when it is whole; what a killed process left of one goes with the next."""

import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from recorders.files import disk

_RANDOM_BYTES = 4


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Make a folder in a hidden one beside `path`, which is locked meanwhile and removed when the block ends.

    Whoever fills it brings its files and their names to the disk, and then renames it.

    Parameters
    ----------
    path : Path
        What the folder is to be called; so it is called in the hidden one, too.

    Yields
    ------
    Path
        The folder, empty.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    _remove_left(path)
    hidden = path.with_name(f".{path.name}.{secrets.token_hex(_RANDOM_BYTES)}.new")
    disk.make_folder(hidden)
    try:
        with disk.locked_folder(hidden):
            disk.make_folder(hidden / path.name)
            yield hidden / path.name
    finally:
        disk.remove_tree(hidden)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Make a folder that gets its name, on the disk with all its files, when the block ends, and goes if it fails.

    Parameters
    ----------
    path : Path
        What the folder is to be called.

    Yields
    ------
    Path
        The folder, empty; whoever fills it brings what is in its files to the disk.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    with new_folder(path) as folder:
        yield folder
        sync_folders(folder)
        disk.rename(folder, path)
    disk.sync_folder(path.parent)


def sync_folders(folder: Path) -> None:
    """Have the disk take the names in a folder, and in those that are in it; raises OSError."""
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            sync_folders(path)
    disk.sync_folder(folder)


def _remove_left(path: Path) -> None:
    """Remove what killed processes left, as far as locks show that nobody fills it any more; raises nothing."""
    left = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{{2 * _RANDOM_BYTES}}}\.new")
    with suppress(OSError):
        for hidden in sorted(path.parent.iterdir()):
            if left.fullmatch(hidden.name):
                with suppress(OSError), disk.locked_folder(hidden) as is_ours:
                    if is_ours:
                        disk.remove_tree(hidden)
