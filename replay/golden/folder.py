"""Folders of golden cases: finding them, and putting a new case in the place of an old one. Imports nothing heavy."""

from collections.abc import Iterator
from pathlib import Path

from recorders.errors import ConfigError, LogError, unreadable
from recorders.files import disk

CASE_FILE = "case.json"
_REPLACED = ".replaced"


def find_cases(folder: Path) -> list[Path]:
    """Return the folders of the cases in a folder, at any depth, by name; a case's own folder is one.

    Folders whose names begin with a dot are left out, and so is whatever lies within a case.

    Raises
    ------
    ConfigError
        If there is none, a folder cannot be read or is a link out of this one, or the replacement of a case was cut
        short.
    """
    try:
        found = list(_cases(folder, set(), tree=folder.resolve()))
    except OSError as error:
        raise ConfigError(unreadable(error.filename, error)) from error
    if not found:
        raise ConfigError(f"{folder}: expected golden cases, folders with a {CASE_FILE}; make one with golden add")
    return found


def swap_in(new: Path, folder: Path) -> None:
    """Put a new case, on the disk, in the place of the old one, if there is one.

    On failure, of whatever kind, the old one is back, unless the new one has the name already.

    Raises
    ------
    LogError
        If the folders cannot be renamed.
    """
    old = _aside(folder)
    try:
        if folder.exists():
            disk.rename(folder, old)
        disk.rename(new, folder)
        disk.sync_folder(folder.parent)
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:  # an interrupt is no OSError
        roll_back(folder)


def roll_back(folder: Path) -> None:
    """Undo a replacement that was cut short: without a new case, the old one goes back to its place.

    Raises
    ------
    LogError
        If it cannot.
    """
    old = _aside(folder)
    if not old.exists():
        return
    try:
        if folder.exists():
            disk.sync_folder(folder.parent)  # the new one has the name, whatever happens, before the old one goes
            disk.remove_tree(old)
        else:
            disk.rename(old, folder)
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror or error}; the case as it was is {old}") from error


def _aside(folder: Path) -> Path:
    """Path of the old case while the new one is put in its place: outside every folder that is cleaned up."""
    return folder.with_name(f".{folder.name}{_REPLACED}")


def _cases(folder: Path, seen: set[Path], *, tree: Path) -> Iterator[Path]:
    if not folder.resolve().is_relative_to(tree):
        raise ConfigError(f"{folder}: expected a folder within {tree}, found a link that leads out of it")
    if (folder / CASE_FILE).is_file():
        yield folder
        return
    seen.add(folder.resolve())
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name.startswith("."):
            _refuse_cut_short(path)
        elif path.is_dir() and path.resolve() not in seen:  # a link may lead back
            yield from _cases(path, seen, tree=tree)


def _refuse_cut_short(path: Path) -> None:
    """Refuse the remains of a replacement that was killed half-way: the case would be missing without notice."""
    folder = path.with_name(path.name[1:].removesuffix(_REPLACED))
    if path.name.endswith(_REPLACED) and not folder.exists():
        raise ConfigError(f"{path}: a golden add was cut short, and this is the case as it was: rename it {folder}")
