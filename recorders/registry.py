"""Things that others may bring, by name: our own modules of a room, and entry points of what is installed beside us.

A name that a file or the network gives is looked up among these and never imported for itself.
"""

import importlib
import pkgutil
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, Generic, Protocol, TypeVar

from recorders.errors import ConfigError
from recorders.text.wording import names_text


class Named(Protocol):
    """Thing with a name, under which it is registered."""

    @property
    def name(self) -> str:
        """The name."""


Found = TypeVar("Found", bound=Named)


class Registry(Generic[Found]):
    """Registry of one kind of thing.

    Our own are modules of a room, each named as what it holds, with `-` in place of `_`; those of others are entry
    points of a group.

    Parameters
    ----------
    what : str
        Kind of thing, for error lines, such as "learning rule".
    kind : type
        Class of the things.
    room : module
        Package of our own modules.
    constant : str
        Name under which each of them holds its thing.
    group : str
        Group of the entry points of others.
    """

    def __init__(self, what: str, kind: type[Found], *, room: ModuleType, constant: str, group: str) -> None:
        self._what = what
        self._kind = kind
        self._room = room
        self._constant = constant
        self._group = group
        self._found: dict[str, Found] = {}

    def names(self) -> tuple[str, ...]:
        """Return the names of all things, our own first."""
        own = self._own()
        return (*own, *sorted({entry.name for entry in entry_points(group=self._group)} - set(own)))

    def find(self, name: str) -> Found:
        """Return a thing by its name.

        Raises
        ------
        ConfigError
            If there is none, or what is installed under this name is none.
        """
        if name not in self._found:
            loaded = self._load(name)
            if type(loaded) is not self._kind or loaded.name != name:
                kind = f"{self._kind.__module__}.{self._kind.__qualname__}"
                raise ConfigError(f"{self._what} {name}: expected a {kind} of this name, found another")
            self._found[name] = loaded
        return self._found[name]

    def forget(self) -> None:
        """Look everything up anew from now on: what is installed has changed."""
        self._found.clear()

    def _own(self) -> tuple[str, ...]:
        return tuple(sorted(module.name.replace("_", "-") for module in pkgutil.iter_modules(self._room.__path__)))

    def _load(self, name: str) -> Any:
        if name in self._own():
            return getattr(importlib.import_module(f"{self._room.__name__}.{name.replace('-', '_')}"), self._constant)
        return self._load_entry(name, [entry for entry in entry_points(group=self._group) if entry.name == name])

    def _load_entry(self, name: str, entries: list[EntryPoint]) -> Any:
        if len(entries) != 1:
            found = f"{len(entries)} installed under this name" if entries else "none"
            raise ConfigError(
                f"expected a {self._what}, one of {names_text(self.names())}; {name!r:.60}: found {found}"
            )
        try:
            return entries[0].load()
        except Exception as error:  # whatever a module of others raises when it is imported
            line = " ".join(str(error).split())
            raise ConfigError(f"{self._what} {name}: cannot be loaded: {line}") from error
