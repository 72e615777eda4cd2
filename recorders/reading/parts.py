"""Recordings by their names: one file, one that was split or a list of logs, a folder, a stem of several names."""

import logging
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

from recorders.errors import LogError
from recorders.files.regular_file import begins_with
from recorders.mcap_format.records import MAGIC
from recorders.reading.bag_metadata import METADATA_FILE, is_bag_folder, read_bag_metadata
from recorders.reading.file_kind import ROS1_MAGIC, SQLITE_MAGIC
from recorders.reading.lerobot_info import INFO_FILE, is_lerobot_folder, read_lerobot_info
from recorders.reading.reader import LogReader
from recorders.text.wording import names_text

logger = logging.getLogger(__name__)

PART = "part"
"""The entry of the manifest that states which part of which session a log is: `session`, `number`, `more`."""

MAX_PARTS = 10**6

_NUMBERED = re.compile(r"(.+)_(\d{1,9})(\.mcap)", re.IGNORECASE)
_SET_ASIDE = re.compile(r"\.part\.\d+$")
_SUFFIX = ".mcap"
_SHOWN = 3  # names in a line
_MAGICS = (MAGIC, SQLITE_MAGIC, ROS1_MAGIC)


class _Part(NamedTuple):
    """The place of a log in a session: which session, which part, and whether others follow."""

    session: str
    number: int
    more: bool


@dataclass(frozen=True)
class Parts:
    """The logs of one session, in order; `name`, `stem` and text are as those of the one log that they stand for.

    Attributes
    ----------
    paths : tuple of Path
        One or more.
    """

    paths: tuple[Path, ...]

    @property
    def name(self) -> str:
        """The name without the number."""
        return _split_name(self.paths[0].name)

    @property
    def stem(self) -> str:
        """The name without number and ending."""
        return Path(self.name).stem

    def __str__(self) -> str:
        return f"{self.paths[0].with_name(self.name)} (in {len(self.paths)} parts)"


Log: TypeAlias = Path | Parts
"""Path of a recording in one file, or those of several parts."""


def part_path(out: Path, number: int) -> Path:
    """Return where a part of a session goes that is named `out`: numbered so that a thousand parts sort by name."""
    return out.with_name(f"{out.stem}_{number:03d}{_SUFFIX}")


def parts_in(folder: Path, stem: str) -> list[Path]:
    """Return the parts of a session in a folder by their numbers, those that are not finished included."""
    numbered = re.compile(re.escape(stem) + r"_\d{1,9}\.mcap(\.part)?", re.IGNORECASE)
    found = (path for path in folder.glob("*") if numbered.fullmatch(path.name) and not _is_second_name(path))
    return sorted(found, key=_number)


def _is_second_name(path: Path) -> bool:
    """Whether a `.part` is the finished log beside it, as a crash just before it lost this name leaves it."""
    with suppress(OSError):
        return path.suffix == ".part" and path.samefile(path.with_suffix(""))
    return False


def find_log(path: Path) -> Log:
    """Return the recording that a path names: a log, a folder of a session's parts, or the stem of such parts.

    Raises
    ------
    LogError
        If a folder holds no log or those of several recordings, or a part is missing or not finished.
    """
    if path.is_dir():
        return _in_folder(path)
    if not path.exists() and (parts := parts_in(path.parent, path.stem if _ends_as_log(path) else path.name)):
        return _whole(parts)
    return path


def files_of(log: Log) -> tuple[Path, ...]:
    """Return the files that a recording is in, in order; raises LogError if those of a folder cannot be found out."""
    if isinstance(log, Parts):
        return log.paths
    if is_lerobot_folder(log):
        return (log / INFO_FILE, *read_lerobot_info(log).files)
    return (log / METADATA_FILE, *read_bag_metadata(log).files) if is_bag_folder(log) else (log,)


def one_session(paths: Sequence[Path]) -> Log:
    """Return the one session that a list of logs is: numbered parts go by their numbers, other logs as listed.

    A part that is named without the others is reported.

    Parameters
    ----------
    paths : sequence of Path
        Logs or parts, or one folder or stem.

    Raises
    ------
    LogError
        As from `find_log`, or if there is no log, or one of the parts is of another session.
    """
    if not paths:
        raise LogError("expected at least one log, found none")
    if len(paths) == 1:
        if (part := _part(paths[0])) and (part.number or part.more):
            whole = _split_name(paths[0].name)
            logger.warning(f"{paths[0]} is one part of a session, taken alone; {whole} beside it names them all")
        return find_log(paths[0])
    if len({_split_name(path.name) for path in paths}) == 1:
        return _whole(sorted(paths, key=_number))
    return Parts(tuple(paths))


def recordings(paths: Sequence[Path]) -> list[Log]:
    """Return the recordings that are named, in this order; those of several parts of one session are one.

    A part that is named without the others is reported.

    Parameters
    ----------
    paths : sequence of Path
        Logs, parts, folders and stems.

    Raises
    ------
    LogError
        As from `find_log`.
    """
    sessions: dict[str, list[Path]] = {}
    for index, path in enumerate(paths):
        part = _part(path)
        sessions.setdefault(part.session if part else f"log {index}", []).append(path)
    return [one_session(members) for members in sessions.values()]


def is_followed(path: Path) -> bool:
    """Whether a finished part states that another one follows it."""
    part = _part(path)
    return part is not None and part.more


def is_log(path: Path) -> bool:
    """Whether a path names a recording: a file by its first bytes or its ending, or what `find_log` finds logs for."""
    if path.is_dir():
        return is_bag_folder(path) or is_lerobot_folder(path) or bool(_logs_in(path) or _logs_in(path, SQLITE_MAGIC))
    if path.is_file():
        return _ends_as_log(path) or any(begins_with(path, magic) for magic in _MAGICS)
    return _ends_as_log(path) or bool(parts_in(path.parent, path.name))


def _in_folder(folder: Path) -> Log:
    if is_bag_folder(folder):
        return _bag(folder)
    if is_lerobot_folder(folder):
        return folder
    logs = _logs_in(folder) or _logs_in(folder, SQLITE_MAGIC)
    if logs and len(logs) > 1 and begins_with(logs[0], SQLITE_MAGIC):
        raise LogError(f"{folder}: expected {METADATA_FILE} beside its {len(logs)} files; `ros2 bag reindex` writes it")
    names = {_split_name(path.name.removesuffix(".part")) for path in logs}
    if not logs:
        raise LogError(f"{folder}: expected a log, or the parts of a session in a folder, found no MCAP file in it")
    if len(names) > 1:
        some = ", ".join(path.name for path in logs[:_SHOWN]) + (", …" if len(logs) > _SHOWN else "")
        raise LogError(f"{folder}: expected the parts of one session in the folder, found {some}; name those you mean")
    return logs[0] if len(logs) == 1 else _whole(sorted(logs, key=_number))


def _bag(folder: Path) -> Log:
    """Return the recording in a rosbag2 folder: its files if they are MCAP as it is, else the folder."""
    about = read_bag_metadata(folder)
    if about.storage != "mcap" or about.compression_mode:
        return folder
    return about.files[0] if len(about.files) == 1 else Parts(about.files)


def _logs_in(folder: Path, magic: bytes = MAGIC) -> list[Path]:
    """Return the files of a folder that are logs, those that are still written or were cut off included.

    What a crash left of other recordings and was set aside, as `NAME.part.0001`, is not.
    """
    files = (path for path in folder.iterdir() if path.is_file() and not _SET_ASIDE.search(path.name))
    return sorted(path for path in files if begins_with(path, magic))


def _whole(parts: Sequence[Path]) -> Parts:
    """Return the parts, in order, as a session; raises LogError if one is missing, not finished, or not of it."""
    name = parts[0].with_name(_split_name(parts[0].name.removesuffix(".part")))
    parts = [path for path in parts if not (path.suffix == ".part" and path.with_suffix("") in parts)]  # it is mended
    for path in parts:
        if path.suffix == ".part":
            finished = path.with_suffix("")
            mended = finished.with_name(f"recovered_{finished.name}")
            raise LogError(
                f"{path}: a part of {name.name} that is still recorded, or was cut off: "
                f"`reenact recover {path} --out {mended} && mv {mended} {finished}` brings back what is whole"
            )
    stated = [_part(path) for path in parts]  # a damaged one states nothing, and its reader reports it
    if len({part.session for part in stated if part}) > 1:
        raise LogError(f"{name}: expected the parts of one session, found those of several; name those you mean")
    named = [part.number if part else _number(path) for path, part in zip(parts, stated, strict=True)]
    order = sorted(range(len(parts)), key=named.__getitem__)  # by the parts' own numbers, whatever they are called now
    parts, stated, numbers = [parts[row] for row in order], [stated[row] for row in order], sorted(named)
    first = 0 if any(stated) else numbers[0]
    end = numbers[-1] + (2 if stated[-1] and stated[-1].more else 1)
    if len(numbers) != end - first or numbers != list(range(first, end)):
        there = set(numbers)
        missing = next((number for number in range(first, end) if number not in there), None)
        wrong = "a part is named twice" if missing is None else f"part {missing} is missing"
        found = names_text(map(str, numbers))
        raise LogError(f"{name}: {wrong}: expected parts {first} to {end - 1}, found {found}")
    return Parts(tuple(parts))


def _part(path: Path) -> _Part | None:
    """Return which part of a session a log is, by its own statement; None if it states none, or cannot be read."""
    if not (_NUMBERED.fullmatch(path.name) and path.is_file()):
        return None
    try:
        found = LogReader(path).manifest.get(PART)
    except LogError:
        return None
    if not isinstance(found, dict):
        return None
    session, number, more = (found.get(name) for name in _Part._fields)
    if isinstance(session, str) and type(number) is int and 0 <= number < MAX_PARTS:
        return _Part(session, number, more is True)
    return None


def _split_name(name: str) -> str:
    """Return the name of the session that a part of this name belongs to; the name itself if it has no number."""
    found = _NUMBERED.fullmatch(name)
    return found[1] + found[3] if found else name


def _number(path: Path) -> int:
    found = _NUMBERED.fullmatch(path.name.removesuffix(".part"))
    return int(found[2]) if found else 0


def _ends_as_log(path: Path) -> bool:
    return path.suffix.lower() == _SUFFIX
