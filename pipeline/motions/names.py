"""Names of the motions that come with the program: patterns, and the drawings in `data/motions`."""

import pkgutil
from pathlib import Path

from pipeline.motions import patterns
from pipeline.resources import data_path

PATTERNS = ("circles", "eight")
"""The paper's."""


def drawings() -> dict[str, Path]:
    """Return the drawings that come with the program, by name."""
    return {path.stem: path for path in sorted(data_path("motions").glob("*.csv"))}


def motion_names() -> list[str]:
    """Return the names that stand for a motion wherever one is asked for: patterns, then drawings."""
    others = {module.name.replace("_", "-") for module in pkgutil.iter_modules(patterns.__path__)} - set(PATTERNS)
    return [*PATTERNS, *sorted(others), *drawings()]
