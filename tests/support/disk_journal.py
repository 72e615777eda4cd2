"""What was done to a folder, operation by operation, and what a loss of power leaves of it."""

import os
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

OUTCOMES = ("kill", "none", "names", "data", "prefix", "subset")
DRAWN = ("prefix", "subset")

_SECTOR = 512


@dataclass(eq=False)
class Write:
    """Bytes written to a place; what a failed sync had is `lost`: no later sync counts for it."""

    place: int
    data: bytes
    synced: bool = False
    lost: bool = False


@dataclass(eq=False)
class File:
    """What a file held at first, and what was written to it since."""

    begin: bytes = b""
    writes: list[Write] = field(default_factory=list)

    def write(self, place: int, data: bytes) -> None:
        """Note what is written."""
        self.writes.append(Write(place, data))

    def sync(self) -> None:
        """Note that the disk has what was written."""
        for write in self.writes:
            write.synced = write.synced or not write.lost

    def fail_sync(self) -> None:
        """Note that the disk need not have it, and that the system takes it for written nevertheless."""
        for write in self.writes:
            write.lost = write.lost or not write.synced

    def content(self, pieces: list[tuple[int, bytes]] | None = None) -> bytes:
        """Return what it holds, with all that was written or with these pieces alone."""
        data = bytearray(self.begin)
        for place, piece in [(write.place, write.data) for write in self.writes] if pieces is None else pieces:
            data.extend(bytes(max(0, place + len(piece) - len(data))))
            data[place : place + len(piece)] = piece
        return bytes(data)

    def remains(self, outcome: str, draw: random.Random) -> bytes:
        """Return what is left: what was synced, and of the rest some sectors, in place or as zeros."""
        pieces: list[tuple[int, bytes]] = []
        for write in self.writes:
            if write.synced or outcome in ("kill", "data"):
                pieces.append((write.place, write.data))
            elif outcome in DRAWN:
                for start in range(0, len(write.data), _SECTOR):
                    piece, fate = write.data[start : start + _SECTOR], draw.random()
                    if fate < 0.7:
                        pieces.append((write.place + start, piece if fate < 0.5 else bytes(len(piece))))
        return self.content(pieces)


@dataclass(eq=False)
class Folder:
    """Files and folders by name, as the process sees them."""

    names: dict[str, "Entry"] = field(default_factory=dict)

    def paths(self, path: Path) -> Iterator[tuple[Path, "Entry"]]:
        """Yield all that is in it, at any depth, if it is called `path`."""
        for name, entry in self.names.items():
            yield path / name, entry
            if isinstance(entry, Folder):
                yield from entry.paths(path / name)


Entry: TypeAlias = File | Folder

Tree: TypeAlias = dict[str, bytes | None]

_Names: TypeAlias = dict[Folder, dict[str, Entry]]


@dataclass(eq=False)
class _Change:
    """Names that come or go together."""

    names: list[tuple[Folder, str, Entry | None]]
    synced: bool = False


class Journal:
    """Everything that is done to a folder.

    Parameters
    ----------
    root : Path
        A real folder; what is in it is on the disk. What is outside of it is not noted.
    """

    def __init__(self, root: Path) -> None:
        self._root = _absolute(root)
        self._tree = _read_tree(self._root)
        self._begin: _Names = dict(_names_of(self._tree))
        self._changes: list[_Change] = []

    def find(self, path: Path) -> Entry:
        """Return what has a name; outside of the folder, any file."""
        entry: Entry = self._tree
        if not self._has(path):
            return File()
        for name in _absolute(path).relative_to(self._root).parts:
            assert isinstance(entry, Folder)
            entry = entry.names[name]
        return entry

    def name(self, path: Path, entry: Entry | None) -> None:
        """Note that a name was given, or taken away."""
        self._change([(path, entry)])

    def make_folder(self, path: Path) -> None:
        """Note a new folder."""
        self._change([(path, Folder())])

    def rename(self, old: Path, new: Path) -> None:
        """Note that a name was taken away and another one given, at once."""
        self._change([(new, self.find(old)), (old, None)])

    def sync_folder(self, folder: Path) -> None:
        """Note that the disk has the names in a folder; what was renamed out of it it has as a whole."""
        if not self._has(folder):
            return
        asked = self.find(folder)
        for change in self._changes:
            change.synced = change.synced or any(of is asked for of, _, _ in change.names)

    def survivors(self, outcome: str, *, seed: int = 0) -> "Tree":
        """Return what a crash leaves.

        Parameters
        ----------
        outcome : str
            `kill`: the process alone went, and all that the system had is there. Otherwise the power did: of what was
            not synced there is `none`, all the `names`, all the `data`, a `prefix` of the names in the order of their
            changes with any of the data, or any `subset` of both.
        seed : int
            Draws them.

        Returns
        -------
        dict of str to bytes
            What files hold, and None for folders, by path within the folder.
        """
        draw = random.Random(seed)
        unsynced = [change for change in self._changes if not change.synced]
        if outcome == "prefix":
            chosen = unsynced[: draw.randint(0, len(unsynced))]
        else:
            share = {"none": 0.0, "data": 0.0, "subset": 0.5}.get(outcome, 1.0)
            chosen = [change for change in unsynced if draw.random() < share]
        there = set(map(id, chosen))
        names: _Names = {folder: dict(entries) for folder, entries in self._begin.items()}
        for change in self._changes:
            if change.synced or id(change) in there:
                for folder, name, entry in change.names:
                    _set(names.setdefault(folder, {}), name, entry)
        known: dict[File, bytes] = {}

        def remains(file: File) -> bytes:
            """Return what is left of a file, the same for all its names."""
            if file not in known:
                known[file] = file.remains(outcome, draw)
            return known[file]

        return dict(_left(self._tree, names, Path(), remains))

    def check(self) -> None:
        """Assert that nothing was done to the folder that is not noted."""
        expected = dict(self._tree.paths(self._root))
        found = {Path(folder, name) for folder, folders, files in os.walk(self._root) for name in (*folders, *files)}
        assert found == set(expected), f"not noted: {found ^ set(expected)}"
        for path, entry in expected.items():
            assert isinstance(entry, Folder) or path.read_bytes() == entry.content(), f"not noted: what is in {path}"

    def _has(self, path: Path) -> bool:
        return _absolute(path).is_relative_to(self._root)

    def _change(self, names: list[tuple[Path, Entry | None]]) -> None:
        change = _Change([])
        for path, entry in names:
            if not self._has(path):
                continue
            folder = self.find(path.parent)
            assert isinstance(folder, Folder)
            _set(folder.names, path.name, entry)
            change.names.append((folder, path.name, entry))
        self._changes.append(change)


def _absolute(path: Path) -> Path:
    return path.parent.resolve() / path.name


def _set(names: dict[str, Entry], name: str, entry: Entry | None) -> None:
    names.pop(name, None)
    if entry is not None:
        names[name] = entry


def _read_tree(folder: Path) -> Folder:
    found = Folder()
    for path in sorted(folder.iterdir()):
        found.names[path.name] = _read_tree(path) if path.is_dir() else File(path.read_bytes())
    return found


def _names_of(folder: Folder) -> Iterator[tuple[Folder, dict[str, Entry]]]:
    yield folder, dict(folder.names)
    for entry in folder.names.values():
        if isinstance(entry, Folder):
            yield from _names_of(entry)


def _left(
    folder: Folder, names: _Names, path: Path, remains: Callable[[File], bytes]
) -> Iterator[tuple[str, bytes | None]]:
    for name, entry in names.get(folder, {}).items():
        inside = path / name
        if isinstance(entry, Folder):
            yield str(inside), None
            yield from _left(entry, names, inside, remains)
        else:
            yield str(inside), remains(entry)


def write_tree(tree: Tree, into: Path) -> None:
    """Make a folder of what a crash leaves; what is the same object is one file with several names."""
    into.mkdir()
    known: dict[int, Path] = {}
    for name, content in tree.items():
        path = into / name
        if content is None:
            path.mkdir()
        elif len(content) > 1 and id(content) in known:  # shorter ones may be one object by chance
            path.hardlink_to(known[id(content)])
        else:
            path.write_bytes(content)
            known[id(content)] = path
