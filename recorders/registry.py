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
    named_as_module : bool
        Whether our own are known by the names of their modules, which are imported when they are asked for; if not,
        all are imported for their names.
    """

    def __init__(
        self,
        what: str,
        kind: type[Found],
        *,
        room: ModuleType,
        constant: str,
        group: str,
        named_as_module: bool = True,
    ) -> None:
        self._what = what
        self._kind = kind
        self._room = room
        self._constant = constant
        self._group = group
        self._named_as_module = named_as_module
        self.forget()

    def names(self) -> tuple[str, ...]:
        """Return the names of all things, our own first."""
        own = self._own()
        return (*own, *sorted(set(self._entries()) - set(own)))

    def find(self, name: str) -> Found:
        """Return a thing by its name.

        Raises
        ------
        ConfigError
            If there is none, or what is installed under this name is none.
        """
        if (found := self.get(name)) is None:
            raise ConfigError(f"expected a {self._what}, one of {names_text(self.names())}; {name!r:.60}: found none")
        return found

    def get(self, name: str) -> Found | None:
        """Return a thing by its name, None if there is none; raises ConfigError as `find` does."""
        if (found := self._found.get(name)) is not None:
            return found
        if name in self._own():
            loaded = self._load_own(self._own()[name])
        elif name in self._entries():
            loaded = self._load_entry(name, self._entries()[name])
        else:
            return None
        if type(loaded) is not self._kind or loaded.name != name:
            kind = f"{self._kind.__module__}.{self._kind.__qualname__}"
            raise ConfigError(f"{self._what} {name}: expected a {kind} of this name, found another")
        return self._found.setdefault(name, loaded)

    def forget(self) -> None:
        """Look everything up anew from now on: what is installed has changed."""
        self._found: dict[str, Found] = {}
        self._modules: dict[str, str] | None = None
        self._installed: dict[str, list[EntryPoint]] | None = None

    def _own(self) -> dict[str, str]:
        """Return the modules of our own things, by name."""
        if self._modules is None:
            modules = sorted(module.name for module in pkgutil.iter_modules(self._room.__path__))
            if self._named_as_module:
                self._modules = {module.replace("_", "-"): module for module in modules}
            else:
                self._modules = {self._load_own(module).name: module for module in modules}
        return self._modules

    def _entries(self) -> dict[str, list[EntryPoint]]:
        if self._installed is None:
            self._installed = {}
            for entry in entry_points(group=self._group):
                self._installed.setdefault(entry.name, []).append(entry)
        return self._installed

    def _load_own(self, module: str) -> Any:
        return getattr(importlib.import_module(f"{self._room.__name__}.{module}"), self._constant)

    def _load_entry(self, name: str, entries: list[EntryPoint]) -> Any:
        if len(entries) != 1:
            raise ConfigError(f"{self._what} {name}: expected one, found {len(entries)} installed under this name")
        try:
            return entries[0].load()
        except Exception as error:  # whatever a module of others raises when it is imported
            line = " ".join(str(error).split())
            raise ConfigError(f"{self._what} {name}: cannot be loaded: {line}") from error
