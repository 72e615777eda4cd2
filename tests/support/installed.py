"""Things from outside the package, installed for a test: a module, and the metadata of its distribution."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from recorders.registry import Registry


@contextmanager
def installed(
    site: Path, module: ModuleType, registry: Registry[Any], *, group: str, entries: Mapping[str, str]
) -> Iterator[None]:
    """Install a module in a folder for the time of a block, with entry points: names in it, by the points' names."""
    name = module.__name__
    metadata = site / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: 1.0\n")
    points = "".join(f"{point} = {name}:{found}\n" for point, found in entries.items())
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{points}")
    assert module.__file__ is not None
    shutil.copy(module.__file__, site)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        registry.forget()
        yield
    registry.forget()
