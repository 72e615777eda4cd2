"""A team's own learner settings and robot beside those that a golden case has copies of."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.learner.registry import KEY, config_from_dict, config_to_dict, find_rule
from pipeline.learner.rule import DEFAULT, Settings
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.recorded import require_recorded_robot
from pipeline.robot.toml_text import MAX_BYTES, parse_toml
from pipeline.samples.pairing import COMMANDED, find_pairing
from pipeline.training.pairing_choice import pairing_for
from pipeline.urdf.description import canonical_urdf
from recorders.errors import ConfigError, unreadable
from recorders.files.regular_file import require_regular_file
from recorders.reading.file_kind import mixed_up_kind
from recorders.reading.reader import LogReader
from recorders.text.wording import value_text
from replay.diff.fields import format_pair
from replay.golden.recipe import CaseSpec

_FOLLOWING = {
    "inputs": "the robot's hands",
    "outputs": "the robot's joints",
    "body": "the robot",
    "epochs": "--epochs, or the session",
}
"""Settings that a learner takes from elsewhere, and where from."""

PAIRS_KEY = "pairs"
"""Setting that names the pairing rule; absent for the paper's."""

_PART = re.compile(r'<(link|joint) name="([^"]*)"')
_TEXTS = ("urdf_text", "toml_text")


def pairs_of(learner: Mapping[str, Any]) -> str:
    """Return the name of the pairing rule among settings; raises ConfigError if it is no text."""
    name = learner.get(PAIRS_KEY, COMMANDED)
    if type(name) is not str:
        raise ConfigError(f"expected learner setting {PAIRS_KEY} to be a text, found {value_text(name)}")
    return name


def without_pairs(learner: Mapping[str, Any]) -> Settings:
    """Return the learner's configuration among settings; raises ConfigError as `config_from_dict` does."""
    return config_from_dict({name: value for name, value in learner.items() if name != PAIRS_KEY})


def with_pairs(learner: Mapping[str, Any], pairs: str) -> dict[str, Any]:
    """Return settings with a pairing rule; the paper's is not named."""
    others = {name: value for name, value in learner.items() if name != PAIRS_KEY}
    return others if pairs == COMMANDED else {PAIRS_KEY: pairs} | others


def with_pairs_for(learner: Mapping[str, Any], logs: Sequence[Path], *, as_recorded: bool) -> dict[str, Any]:
    """Return settings with the pairing rule that they name, or the one in its place where a log lacks topics of it.

    Raises
    ------
    ConfigError
        If there is no rule of this name.
    LogError, RobotError
        If a log cannot be read, or its robot cannot be used.
    """
    return with_pairs(learner, pairing_for(find_pairing(pairs_of(learner)), logs, as_recorded=as_recorded).name)


def read_settings(
    path: Path | None, *, rule: str | None = None, pairs: str | None = None, before: str | None = None
) -> dict[str, Any]:
    """Return all settings of a learner, of which the file (TOML), if there is one, names some.

    Parameters
    ----------
    path : Path, optional
        The file.
    rule : str, optional
        The learning rule, where the file does not name it.
    pairs : str, optional
        The pairing rule, where the file does not name it.
    before : str, optional
        The pairing rule where neither names one; that of the learning rule if left out.

    Raises
    ------
    ConfigError
        If the file cannot be read, or a setting is unknown, out of range, or not to be set.
    """
    values = {} if path is None else _read_toml(path)
    for name, option in ((KEY, rule), (PAIRS_KEY, pairs)):
        if option is not None and values.setdefault(name, option) != option:
            raise ConfigError(f"expected the {name} that {path} names, found --{name} {option!r:.60}")
    for name, source in _FOLLOWING.items():
        if name in values:
            raise ConfigError(f"{path}: expected no setting {name}, which follows from {source}; take it out")
    try:
        settings = without_pairs(values)
        chosen = pairs_of(values) if PAIRS_KEY in values else before or find_rule(settings.rule).pairs
        return with_pairs(config_to_dict(settings), find_pairing(chosen).name)
    except ConfigError as error:
        raise ConfigError(f"{path or '--rule'}: {error}") from error


class Own:
    """Settings and robot of a team today, to be compared with those of a case.

    Parameters
    ----------
    config : Path, optional
        Settings of the learner (TOML).
    robot : str, optional
        The robot: its folder, or its name.

    Raises
    ------
    ConfigError, RobotError
        If one of them cannot be used.
    """

    def __init__(self, *, config: Path | None = None, robot: str | None = None) -> None:
        self._settings = None if config is None else read_settings(config)
        self._robot = None if robot is None else load_robot(robot)

    def difference(self, recipe: CaseSpec) -> tuple[str, str, str] | None:
        """Name the first thing that is not as the case has it: what, in the case, today; None if nothing is.

        Raises
        ------
        LogError
            If a log of the case carries no robot.
        """
        changed = None
        if self._settings is not None:
            settings = with_pairs_for(self._settings, recipe.logs, as_recorded=recipe.as_recorded)
            changed = _of_settings(recipe.learner, settings)
        if changed is not None or self._robot is None:
            return changed
        found = (_of_robots(require_recorded_robot(LogReader(log)), self._robot) for log in recipe.logs)
        return next((difference for difference in found if difference is not None), None)


def _of_settings(old: Any, new: dict[str, Any]) -> tuple[str, str, str] | None:
    plain = {KEY: DEFAULT, PAIRS_KEY: COMMANDED}
    for name, value in (plain | new).items():
        if name not in _FOLLOWING and (found := (plain | old).get(name)) != value:
            return f"learner setting {name}", *format_pair(found, value)
    return None


def _of_robots(old: RobotConfig, new: RobotConfig) -> tuple[str, str, str] | None:
    """Compare what robots are, not how their files are laid out."""
    before, after = _values(old), _values(new)
    for name in {**before, **after}:
        a, b = before.get(name, "nothing"), after.get(name, "nothing")
        if not np.array_equal(a, b):
            return f"robot's {name}", *format_pair(_plain(a), _plain(b))
    part = "the robot"
    for a, b in zip_longest(_tags(old), _tags(new), fillvalue="nothing"):
        if a != b:
            return f"robot.urdf, {part}", *format_pair(a, b)
        if (named := _PART.match(a)) is not None:
            part = f"{named[1]} {named[2]}"
    return None


def _values(robot: RobotConfig) -> dict[str, Any]:
    """Return all that a robot's config sets, hands in their order and one by one."""
    values = {field.name: getattr(robot, field.name) for field in fields(RobotConfig) if field.name not in _TEXTS}
    del values["hands"]
    hands = {f"hand {hand.name}, {name}": value for hand in robot.hands for name, value in asdict(hand).items()}
    return {**values, "hand_names": robot.hand_names, **hands}


def _tags(robot: RobotConfig) -> list[str]:
    """Return the tags of a URDF one by one, in canonical order and without comments."""
    lines = canonical_urdf(robot.urdf_text).replace(">", ">\n").split("\n")
    return [line.strip() for line in lines if line.strip()]


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _read_toml(path: Path) -> dict[str, Any]:
    require_regular_file(path, expected="a TOML file", error=ConfigError)
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_BYTES + 1)  # one character more than is allowed: checked with the text
    except OSError as error:
        raise ConfigError(unreadable(path, error)) from error
    except UnicodeDecodeError as error:
        found = mixed_up_kind(error.object) or f"byte {error.object[error.start]:#04x}"
        raise ConfigError(f"{path}: expected TOML in UTF-8, found {found}") from error
    return parse_toml(text, str(path), error=ConfigError)
