"""Export of a recording to tables, a file for each topic in a new folder."""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from recorders.containers.field_values import FieldValues
from recorders.containers.opening import open_as_it_is
from recorders.containers.reader import Reader
from recorders.errors import ConfigError, LogError, MessageError, MissingExtra
from recorders.export import csv_file
from recorders.export.rows import Columns, Row, row_of
from recorders.messages.topic_patterns import chosen
from recorders.reading.parts import Log
from recorders.text.wording import names_text

FORMATS = ("csv", "parquet")

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
        If the recording cannot be read, holds nothing that can be decoded, or a topic that is named cannot be.
    MissingExtra
        If the format needs a package that is not installed.
    """
    writer = _writer(form)
    if out.exists():
        raise ConfigError(f"{out} exists: choose another name for the folder")
    reader, patterns = open_as_it_is(log), frozenset(topics)
    wanted = chosen(patterns, reader.topics, option="--topic") if patterns else frozenset(reader.topics)
    result = Export()
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as temporary:
        folder = Path(temporary, out.name)
        folder.mkdir()
        for topic in (topic for topic in reader.topics if topic in wanted and reader.counts.get(topic)):
            name = _file_name(topic, result.files.values()) + writer.SUFFIX
            try:
                columns = _columns(reader, topic)
                result.rows[topic] = writer.write(folder / name, columns, _rows(reader, topic))
            except MessageError as error:
                if patterns:
                    raise
                result.unreadable[topic] = str(error)
                continue
            result.files[topic] = out / name
        if not result.files:
            why = names_text(result.unreadable.values(), limit=300)
            raise LogError(f"{reader.path}: expected messages that can be decoded, found none{why and f': {why}'}")
        folder.rename(out)
    return result


def _writer(form: str) -> ModuleType:
    if form not in FORMATS:
        raise ConfigError(f"--format: expected one of {names_text(FORMATS)}, found {form!r:.40}")
    if form == "csv":
        return csv_file
    try:
        from recorders.export import parquet_file  # noqa: PLC0415  # of an extra
    except ModuleNotFoundError:
        raise MissingExtra("pyarrow", "parquet") from None
    return parquet_file


def _rows(reader: Reader, topic: str) -> Iterator[Row]:
    values = FieldValues(reader.channels)
    return (row_of(record, values) for record in reader.records(topics=[topic]))


def _columns(reader: Reader, topic: str) -> Columns:
    columns = Columns()
    for row in _rows(reader, topic):
        columns.add(row)
    return columns


def _file_name(topic: str, taken: Iterable[Path]) -> str:
    """Return a name for the file of a topic that no other has."""
    stem = _NO_NAME.sub("_", topic.strip("/"))[:100] or "topic"
    others = {path.stem for path in taken}
    name: Callable[[int], str] = lambda number: stem if not number else f"{stem}_{number}"  # noqa: E731
    return next(name(number) for number in range(len(others) + 1) if name(number) not in others)
