"""Names of the motions that come with the program: the paper's patterns, and the drawings in `data/motions`."""

from pathlib import Path

from pipeline.resources import data_path

PATTERNS = ("circles", "eight")


def drawings() -> dict[str, Path]:
    """Return the drawings that come with the program, by name."""
    return {path.stem: path for path in sorted(data_path("motions").glob("*.csv"))}


def motion_names() -> list[str]:
    """Return the names that stand for a motion wherever one is asked for: patterns, then drawings."""
    return [*PATTERNS, *drawings()]
