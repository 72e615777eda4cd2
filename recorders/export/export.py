"""Export of a recording to tables, a file for each topic in a new folder."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from types import ModuleType
from typing import Any

from recorders.containers.field_values import FieldValues
from recorders.containers.opening import open_as_it_is
from recorders.containers.reader import Reader
from recorders.errors import ConfigError, LogError, MessageError, MissingExtra
from recorders.export import csv_file
from recorders.export.rows import Columns, row_of
from recorders.files.new_folder import whole_folder
from recorders.messages.topic_patterns import chosen
from recorders.reading.parts import Log
from recorders.text.wording import names_text

FORMATS = ("csv", "parquet")

_AT_ONCE = 64  # tables written in one go through a recording
_NO_NAME = re.compile(r"[^\w.-]+")


@dataclass(frozen=True)
class Export:
    """The result of an export.

    Attributes
    ----------
    files : dict of str to Path
        The file of each topic.
    rows : dict of str to int
        Its rows.
    unreadable : dict of str to str
        Topics that were left out, and why.
    """

    files: dict[str, Path] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        files = {topic: str(path) for topic, path in self.files.items()}
        return {"files": files, "rows": self.rows, "unreadable": self.unreadable}


def export(log: Log, out: Path, *, form: str = "csv", topics: Iterable[str] = ()) -> Export:
    """Write the messages of a recording as tables.

    Parameters
    ----------
    log : Path or Parts
        The recording.
    out : Path
        The folder to make, which has its name once it is whole.
    form : str
        One of `FORMATS`.
    topics : iterable of str
        Patterns of topics; all that can be decoded, if empty.

    Raises
    ------
    ConfigError
        If the format is unknown or the folder exists.
    LogError
        If the recording cannot be read, holds nothing that can be decoded, or a topic that is named cannot be, or the
        tables cannot be written.
    MissingExtra
        If the format needs a package that is not installed.
    """
    writer = _writer(form)
    if out.exists():
        raise ConfigError(f"{out} exists: choose another name for the folder")
    reader, patterns = open_as_it_is(log), frozenset(topics)
    wanted = chosen(patterns, reader.topics, option="--topic") if patterns else frozenset(reader.topics)
    result = Export()
    with _new_folder(out) as folder:
        there = [topic for topic in reader.topics if topic in wanted and reader.counts.get(topic)]
        columns = _columns(reader, there, None if patterns else result.unreadable)
        result.files.update(_files(columns, out, writer.SUFFIX))
        for start in range(0, len(columns), _AT_ONCE):
            some = {topic: columns[topic] for topic in list(columns)[start : start + _AT_ONCE]}
            result.rows.update(_write(reader, some, folder, result.files, writer))
        if not result.files:
            why = names_text(result.unreadable.values(), limit=300)
            raise LogError(f"{reader.path}: expected messages that can be decoded, found none{why and f': {why}'}")
    return result


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """Make the folder of the tables, whole or not at all; raises LogError if it cannot be written."""
    try:
        with whole_folder(out) as folder:
            yield folder
    except OSError as error:
        raise LogError(f"cannot write {out}: {error.strerror or error}") from error


def _writer(form: str) -> ModuleType:
    if form not in FORMATS:
        raise ConfigError(f"--format: expected {names_text(FORMATS)} or lerobot, found {form!r:.40}")
    if form == "csv":
        return csv_file
    try:
        from recorders.export import parquet_file  # noqa: PLC0415  # of an extra
    except ModuleNotFoundError:
        raise MissingExtra("pyarrow", "parquet") from None
    return parquet_file


def _columns(reader: Reader, topics: Sequence[str], unreadable: dict[str, str] | None) -> dict[str, Columns]:
    """Return the columns of each topic; one that cannot be decoded is noted, or raises if `unreadable` is None."""
    values, found = FieldValues(reader.channels), {topic: Columns() for topic in topics}
    for record in reader.records(topics=topics):
        columns = found.get(record.topic)
        if columns is None:
            continue
        try:
            columns.add(row_of(record, values))
        except MessageError as error:
            if unreadable is None:
                raise
            unreadable[record.topic] = str(error)
            del found[record.topic]
    return found


def _write(
    reader: Reader, columns: Mapping[str, Columns], folder: Path, files: Mapping[str, Path], writer: ModuleType
) -> dict[str, int]:
    """Write the tables of some topics in one go through the recording and return how many rows each has."""
    values, counts = FieldValues(reader.channels), dict.fromkeys(columns, 0)
    with ExitStack() as stack:
        tables = {}
        for topic in columns:
            tables[topic] = writer.Table(folder / files[topic].name, columns[topic])
            stack.callback(tables[topic].close)
        for record in reader.records(topics=tables):
            tables[record.topic].add(row_of(record, values))
            counts[record.topic] += 1
    return counts


def _files(topics: Iterable[str], folder: Path, suffix: str) -> dict[str, Path]:
    """Return a file for each topic, of a name that no other has."""
    found: dict[str, Path] = {}
    taken: set[str] = set()
    for topic in topics:
        stem = _NO_NAME.sub("_", topic.strip("/"))[:100] or "topic"
        name = next(name for name in chain([stem], (f"{stem}_{number}" for number in count(1))) if name not in taken)
        taken.add(name)
        found[topic] = folder / (name + suffix)
    return found
