"""Public names of a package, each imported from its module when it is asked for (PEP 562)."""

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence


def lazy_names(
    package: str, homes: Mapping[str, Sequence[str]]
) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Return what a package with lazy names has as `__all__`, `__getattr__` and `__dir__`.

    Parameters
    ----------
    package : str
        Its name.
    homes : mapping of str to sequence of str
        Names by the module that has them.

    Returns
    -------
    tuple of list, callable and callable
        The names, a getter that imports one, and a function that lists all there are.
    """
    home_of = {name: home for home, names in homes.items() for name in names}

    def get(name: str) -> object:
        """Import a name, and keep it; raises AttributeError if there is none."""
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(home_of[name]), name)
        setattr(sys.modules[package], name, found)
        return found

    def every() -> list[str]:
        """Return the names of the package, imported or not."""
        return sorted({*vars(sys.modules[package]), *home_of})

    return sorted(home_of), get, every
