"""The `meta/info.json` of a LeRobotDataset v3: rate, features, and the files that hold the frames.

The format is that of LeRobot (Apache-2.0, https://github.com/huggingface/lerobot, `lerobot.datasets`).
"""

import json
import math
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

from recorders.errors import LogError, unreadable
from recorders.files.regular_file import require_regular_file
from recorders.text.wording import names_text, value_text

INFO_FILE = "meta/info.json"

_MOST_BYTES = 2**24
_MOST_FPS = 100_000
_MOST_NUMBERS = 4096  # of a feature, and of names that are read
_NUMBERS = frozenset({"float16", "float32", "float64"})


class Feature(NamedTuple):
    """A column of a dataset.

    Attributes
    ----------
    dtype : str
        Such as `float32`, `int64` or `video`.
    size : int
        How many numbers it has in a frame; 0 if they are no row.
    names : tuple of str
        Their names; none if there are not as many.
    """

    dtype: str
    size: int
    names: tuple[str, ...]

    @property
    def is_row(self) -> bool:
        """Whether it is a row of floats."""
        return self.dtype in _NUMBERS and self.size > 0


class LeRobotInfo(NamedTuple):
    """What is needed of it.

    Attributes
    ----------
    fps : Fraction
        Frames a second.
    features : dict of str to Feature
        Columns by name.
    files : tuple of Path
        The files of the frames, in order.
    """

    fps: Fraction
    features: dict[str, Feature]
    files: tuple[Path, ...]


def is_lerobot_folder(folder: Path) -> bool:
    """Whether a folder is a dataset of LeRobot."""
    return (folder / INFO_FILE).is_file()


def read_lerobot_info(folder: Path) -> LeRobotInfo:
    """Read what a dataset holds.

    Raises
    ------
    LogError
        If it is of another version than 3, malformed, or has no frames.
    """
    about = _information(folder / INFO_FILE)
    version = about.get("codebase_version")
    if not (isinstance(version, str) and version.startswith("v3.")):
        older = isinstance(version, str) and version.startswith("v2.")
        how = "; LeRobot's own `python -m lerobot.scripts.convert_dataset_v21_to_v30` converts it" if older else ""
        raise LogError(f"{folder}: expected a LeRobotDataset v3, found codebase_version {value_text(version)}{how}")
    fps, features = about.get("fps"), about.get("features")
    if not isinstance(fps, int | float) or isinstance(fps, bool) or not (math.isfinite(fps) and 0 < fps <= _MOST_FPS):
        raise LogError(f"{folder / INFO_FILE}: fps: expected frames a second, found {value_text(fps)}")
    if not isinstance(features, dict):
        raise LogError(f"{folder / INFO_FILE}: features: expected a table, found {value_text(features)}")
    files = tuple(sorted((folder / "data").glob("*/*.parquet")))
    if not files:
        raise LogError(f"{folder}: expected frames in data/chunk-000/file-000.parquet, found no such file")
    for file in files:
        require_regular_file(file, expected="a Parquet file")
    return LeRobotInfo(Fraction(fps), {str(name): _feature(entry) for name, entry in features.items()}, files)


def _feature(entry: Any) -> Feature:
    if not isinstance(entry, Mapping):
        return Feature("", 0, ())
    shape, names = entry.get("shape"), entry.get("names")
    sizes = shape if isinstance(shape, list) and all(type(size) is int for size in shape) else []
    size = sizes[0] if len(sizes) == 1 and 0 < sizes[0] <= _MOST_NUMBERS else 0
    while isinstance(names, Mapping) and len(names) == 1:  # such as {"motors": [...]}
        names = next(iter(names.values()))
    given = tuple(names) if isinstance(names, list) else ()
    known = len(given) == size and all(isinstance(name, str) for name in given)
    return Feature(str(entry.get("dtype"))[:40], size, given if known else ())


def _information(path: Path) -> dict[str, Any]:
    expected = "the description of a LeRobotDataset"
    require_regular_file(path, expected=expected)
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
        found = json.loads(text) if len(text) <= _MOST_BYTES else None
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or "codebase_version" not in found:
        others = names_text(map(str, list(found)[:8]), limit=100) if isinstance(found, dict) else "other content"
        raise LogError(f"{path}: expected {expected}, with codebase_version, found {others or 'nothing'}")
    return found
