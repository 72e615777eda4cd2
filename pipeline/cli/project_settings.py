"""Settings of a project: options of the verbs in `reenact.toml`, or in `[tool.reenact]` of pyproject.toml.

The file is looked for in the working folder and in those above it; the nearest counts. A key is an option without its
dashes. At the top it holds for every verb that has such an option, in a table `[VERB]` for that one alone. The command
line wins.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.robot.toml_text import parse_toml
from recorders.errors import ConfigError
from recorders.files.regular_file import require_regular_file
from recorders.text.wording import names_text, value_text

logger = logging.getLogger(__name__)

_OF_FILE: ContextVar[frozenset[str]] = ContextVar("options that the settings gave to this command", default=frozenset())

SETTINGS_FILE = "reenact.toml"
_PYPROJECT = "pyproject.toml"
_TABLE = "tool.reenact"

_SAID_EACH_TIME = frozenset(("out", "overwrite", "help", "json"))
"""Options that no file sets: where a result goes, and what may be replaced, is for each command to name."""

_ALTERNATIVES = (frozenset(("connect", "listen")), frozenset(("tick-rate", "ticks-of")))
"""Options of which the command line replaces all, if it has one of them."""


@dataclass(frozen=True)
class ProjectSettings:
    """Settings of a file.

    Parameters
    ----------
    path : Path
        The file.
    values : mapping
        What it holds, by key; tables of verbs among them.
    """

    path: Path
    values: Mapping[str, Any]

    def default_map(self, program: Any, arguments: Sequence[str]) -> dict[str, Any]:
        """Return the values of options by verb, as click takes defaults.

        Parameters
        ----------
        program : click.Group
            The verbs.
        arguments : sequence of str
            The command line, of which options count for more.

        Raises
        ------
        ConfigError
            If a key is no option of any verb, or of its own one, or a value is none that it takes.
        """
        given = {argument.partition("=")[0].removeprefix("--") for argument in arguments if argument.startswith("--")}
        replaced = frozenset().union(*(group for group in _ALTERNATIVES if group & given))
        verbs = dict(_verbs(program))
        top = {key: value for key, value in self.values.items() if not isinstance(value, dict)}
        tables = dict(self._tables(verbs))
        found: dict[str, Any] = {}
        used: set[str] = set()
        for verb, options in verbs.items():
            own = tables.pop(verb, {})
            if unknown := [key for key in own if key not in options]:
                raise ConfigError(f"{self.path}: [{'.'.join(verb)}]: no option {names_text(unknown)} of this verb")
            chosen = {key: value for key, value in (top | own).items() if key in options and key not in replaced}
            used |= top.keys() & options.keys()
            place = found
            for part in verb:
                place = place.setdefault(part, {})
            place.update({options[key].name: self._value(key, chosen[key], options[key]) for key in chosen})
            if chosen and list(verb) == list(arguments[: len(verb)]):
                _OF_FILE.set(frozenset(chosen) - given)
                logger.info(f"{self.path}: {', '.join(sorted(chosen))}")
        if unknown := sorted(top.keys() - used):
            raise ConfigError(f"{self.path}: no verb has an option {names_text(unknown)} that a file sets")
        return found

    def _tables(self, verbs: Mapping[tuple[str, ...], object]) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
        """Yield the tables of verbs, `[golden.add]` as that of `golden add`."""
        for key, value in self.values.items():
            if not isinstance(value, dict):
                continue
            inner = {(key, name): table for name, table in value.items() if isinstance(table, dict)}
            own = {name: entry for name, entry in value.items() if not isinstance(entry, dict)}
            for verb, table in [*inner.items(), ((key,), own)] if own or not inner else inner.items():
                if verb not in verbs:
                    raise ConfigError(f"{self.path}: expected a table of a verb, found [{'.'.join(verb)}]")
                yield verb, table

    def _value(self, key: str, value: Any, option: Any) -> Any:
        """Return the value of an option as the command line would have it; a file beside the settings by its path."""
        values = value if isinstance(value, list) else [value]
        if (
            option.is_flag != isinstance(value, bool)
            or isinstance(value, list) != bool(option.multiple)
            or not all(isinstance(entry, str | int | float) for entry in values)
        ):
            expected = "true or false" if option.is_flag else "a list" if option.multiple else "a value"
            raise ConfigError(f"{self.path}: {key}: expected {expected}, found {value_text(value)}")
        if option.is_flag:
            return value
        texts = [self._beside(str(entry)) for entry in values]
        return texts if option.multiple else texts[0]

    def _beside(self, text: str) -> str:
        """Return the path of a file or folder that stands beside the settings, any other text as it is."""
        relative = text.startswith(("./", "../")) or text.endswith("/")
        return str(self.path.parent / text) if relative else text


def project_defaults(program: Any, arguments: Sequence[str]) -> dict[str, Any]:
    """Return the defaults that the project of the working folder sets; see `ProjectSettings.default_map`."""
    _OF_FILE.set(frozenset())  # an earlier command of this process may have had some
    settings = find_settings()
    return {} if settings is None else settings.default_map(program, arguments)


def of_settings(option: str) -> bool:
    """Whether an option has its value from a project's settings: where it is of no use, nobody asked for it there."""
    return option in _OF_FILE.get()


def find_settings(folder: Path | None = None) -> ProjectSettings | None:
    """Return the settings nearest to a folder, in it or above; None if there are none.

    Parameters
    ----------
    folder : Path, optional
        The working folder if left out; one that was removed has no settings.

    Raises
    ------
    ConfigError
        If a file of settings cannot be read.
    """
    if folder is None:
        try:
            folder = Path.cwd()
        except FileNotFoundError:
            return None
    for place in (folder, *folder.parents):
        if (path := place / SETTINGS_FILE).exists():
            return ProjectSettings(path, _read(path))
        if (path := place / _PYPROJECT).exists() and f"[{_TABLE}" in _text(path):
            return ProjectSettings(path, _read(path).get("tool", {}).get("reenact", {}))
    return None


def _read(path: Path) -> dict[str, Any]:
    return parse_toml(_text(path), str(path), error=ConfigError)


def _text(path: Path) -> str:
    require_regular_file(path, expected="a TOML file", error=ConfigError)
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or 'expected UTF-8'}") from None


def _verbs(group: Any, prefix: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Yield every verb, and its options by their long names."""
    for name, command in group.commands.items():
        verb = (*prefix, name)
        yield (
            verb,
            {
                long.removeprefix("--"): param
                for param in command.params
                for long in param.opts
                if long.startswith("--") and long.removeprefix("--") not in _SAID_EACH_TIME
            },
        )
        if hasattr(command, "commands"):
            yield from _verbs(command, verb)
