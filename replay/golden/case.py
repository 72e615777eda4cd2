"""The folder of a golden case: what goes in, what came out, what may differ, and why it was ever changed."""

import json
import re
import stat
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

from recorders.errors import ConfigError, LogError, ReenactError, unreadable
from recorders.files.anonymous_file import write_whole
from recorders.files.whole_files import file_sha256
from recorders.text.wording import json_fault_text, names_text, value_text
from replay.golden.folder import CASE_FILE
from replay.golden.log_tier import LogEntry
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule

FORMAT_VERSION = 1
STEPS_FILE, STATES_FILE = "steps.bin", "states.npz"
STEP_BYTES = 12
"""Of a tick: the first 4 bytes each of the digests of stream, outputs and state."""

MAX_BYTES = 64 << 20
"""Of one file of a case: a case may come from anywhere."""

_MAX_CASE_FILE_BYTES = 1 << 20
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,99}")
_KINDS: dict[str, type | tuple[type, ...]] = {
    "format_version": int,
    "learner": dict,
    "logs": list,
    "schedule": dict,
    "as_recorded": bool,
    "resume_after": (int, type(None)),
    "physics": bool,
    "expected": dict,
    "tolerances": dict,
    "files": dict,
    "environment": dict,
    "history": list,
}
_LOG_KINDS: dict[str, type | tuple[type, ...]] = {"name": str, "sha256": str, "ticks_sha256": str, "attachments": dict}


@dataclass(frozen=True)
class Tolerances:
    """How far from the expected a number may be that is not exact.

    Parameters
    ----------
    errors_cm : float
        Of the errors of the hands [cm]: they come through forward kinematics, which is not promised to the bit.
    joints, hands_m : float
        Of simulated joint positions [rad or m] and hand positions [m].
    """

    errors_cm: float = 1e-9
    joints: float = 1e-9
    hands_m: float = 1e-9

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Read them back; raises ConfigError if one is missing, unknown, or not a number from 0 to 1."""
        names = {item.name for item in fields(cls)}
        if set(values) != names or not all(
            type(value) in (int, float) and 0 <= value <= 1 for value in values.values()
        ):
            raise ConfigError(
                f"tolerances: expected {names_text(sorted(names))}, numbers from 0 to 1, found {value_text(values)}"
            )
        return cls(**values)


@dataclass(frozen=True)
class Case:
    """A case as its folder has it.

    Parameters
    ----------
    folder : Path
        Where it lies; its name is that of the case.
    recipe : CaseSpec
        What is run.
    logs : tuple of LogEntry
        What the logs were when the case was made.
    expected : mapping
        What came of the run: digests, counts, errors in cm.
    tolerances : Tolerances
        What need not be exact.
    files : mapping of str to str
        SHA-256 of the other files of the folder, the logs excepted.
    environment : mapping
        What the case was made on.
    history : tuple of mapping
        Every accepted change: its reason, the digest from then on, and what of the recipe changed with it.
    """

    folder: Path
    recipe: CaseSpec
    logs: tuple[LogEntry, ...]
    expected: Mapping[str, Any]
    tolerances: Tolerances = Tolerances()
    files: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[Mapping[str, Any], ...] = ()

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.folder.name

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of all files of the folder."""
        return (CASE_FILE, *own_files([log.name for log in self.logs]), *(log.name for log in self.logs))

    def read(self, name: str) -> bytes:
        """Return a file of the case that is no log; raises LogError if it is not what it was."""
        path = self.folder / name
        check_size(path)
        if file_sha256(path) != self.files.get(name):
            raise LogError(f"{path}: expected SHA-256 {self.files.get(name)}, found {file_sha256(path)}")
        return path.read_bytes()

    def save(self, files: Mapping[str, bytes]) -> Self:
        """Write the case's own files beside its logs, and return it with their hashes; raises OSError."""
        for name, content in files.items():
            write_whole(self.folder / name, content)
        case = replace(self, files={name: file_sha256(self.folder / name) for name in files})
        write_whole(self.folder / CASE_FILE, (json.dumps(case._to_dict(), indent=1) + "\n").encode())
        return case

    def _to_dict(self) -> dict[str, Any]:
        return {
            "format_version": FORMAT_VERSION,
            "learner": dict(self.recipe.learner),
            "logs": [log.to_dict() for log in self.logs],
            "schedule": self.recipe.schedule.to_dict(),
            "as_recorded": self.recipe.as_recorded,
            "resume_after": self.recipe.resume_after,
            "physics": self.recipe.physics,
            "expected": dict(self.expected),
            "tolerances": asdict(self.tolerances),
            "files": dict(self.files),
            "environment": dict(self.environment),
            "history": [dict(entry) for entry in self.history],
        }


def load_case(folder: Path) -> Case:
    """Read a case.

    Raises
    ------
    LogError
        If its file is missing, too large, or no file.
    ConfigError
        If its file is damaged, or of another format.
    """
    path = folder / CASE_FILE
    values = _read(path)
    try:
        return _case(folder, values)
    except ReenactError as error:
        raise ConfigError(f"{path}: {error}") from error


def _read(path: Path) -> object:
    check_size(path, _MAX_CASE_FILE_BYTES)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected JSON: {json_fault_text(error)}") from error


def check_name(name: str) -> str:
    """Return the name of a case or of a log in one; raises ConfigError if it is no plain file name."""
    if not _NAME.fullmatch(name):
        raise ConfigError(f"expected a plain file name of letters, digits, '_', '.', '+' and '-', found {name[:100]!r}")
    return name


def index_file(log: str) -> str:
    """Return the name of the file that holds the digests of a log's messages."""
    return f"{log}.index"


def own_files(logs: Sequence[str]) -> tuple[str, ...]:
    """Return the names of a case's files beside `case.json` and its logs."""
    return (STEPS_FILE, STATES_FILE, *map(index_file, logs))


def _case(folder: Path, values: object) -> Case:
    table = _typed(values, _KINDS, "the case")
    if table["format_version"] != FORMAT_VERSION:
        raise ConfigError(f"expected golden case format {FORMAT_VERSION}, found {value_text(table['format_version'])}")
    logs = tuple(LogEntry(**_typed(log, _LOG_KINDS, "a log")) for log in table["logs"])
    recipe = CaseSpec(
        logs=tuple(folder / check_name(log.name) for log in logs),
        learner=table["learner"],
        schedule=Schedule.from_dict(table["schedule"]),
        as_recorded=table["as_recorded"],
        resume_after=table["resume_after"],
        physics=table["physics"],
    )
    return Case(
        folder=folder,
        recipe=recipe,
        logs=logs,
        expected=table["expected"],
        tolerances=Tolerances.from_dict(table["tolerances"]),
        files=_files(table["files"], [log.name for log in logs]),
        environment=table["environment"],
        history=_history(table["history"], table["expected"].get("digest")),
    )


def _files(files: dict[str, Any], logs: Sequence[str]) -> dict[str, str]:
    """Check the hashes of the other files; only names that a case gives its own files are ever opened."""
    names = own_files(logs)
    if set(files) != set(names) or not all(isinstance(value, str) for value in files.values()):
        raise ConfigError(f"files: expected the SHA-256 of {names_text(names)}, found {value_text(files)}")
    return files


def _history(entries: list[Any], digest: object) -> tuple[Mapping[str, Any], ...]:
    """Check that every change has a reason and a digest, the last one that which is expected now."""
    for entry in entries:
        if not isinstance(entry, dict) or not all(isinstance(entry.get(name), str) for name in ("reason", "digest")):
            raise ConfigError(f"history: expected entries with reason and digest, found {value_text(entry)}")
    last = entries[-1]["digest"] if entries else None
    if last is None or last != digest:
        raise ConfigError(
            f"history: expected the digest of its last entry to be {value_text(digest)}, found {value_text(last)}"
        )
    return tuple(entries)


def _typed(values: object, kinds: Mapping[str, type | tuple[type, ...]], what: str) -> dict[str, Any]:
    if not isinstance(values, dict) or set(values) != set(kinds):
        raise ConfigError(f"{what}: expected {names_text(kinds)}, found {value_text(values)}")
    for name, kind in kinds.items():
        if not isinstance(values[name], kind) or (isinstance(values[name], bool) and kind is not bool):
            raise ConfigError(f"{what}: {name} is of the wrong type: {str(values[name])[:40]}")
    return values


def check_steps(steps: bytes) -> None:
    """Check that the digests of ticks are whole; raises LogError if not."""
    if len(steps) % STEP_BYTES:
        raise LogError(f"{STEPS_FILE}: expected a multiple of {STEP_BYTES} bytes, found {len(steps)}")


def check_size(path: Path, most: int = MAX_BYTES) -> None:
    """Check that a path is that of a file among the cases, and not too large; raises LogError if not."""
    try:
        found = path.stat()
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
    if not path.resolve().is_relative_to(path.parent.resolve().parent):
        raise LogError(f"{path}: expected a file beside the golden cases, found a link that leads elsewhere")
    if not stat.S_ISREG(found.st_mode):
        raise LogError(f"{path}: expected a file, found something else of that name")
    if found.st_size > most:
        raise LogError(f"{path}: expected at most {most} bytes, found {found.st_size}")
