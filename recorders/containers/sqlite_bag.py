"""The container `.db3`: one file of a rosbag2 recording in sqlite, opened read-only."""

import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

from recorders.containers.foreign_reader import ForeignReader
from recorders.containers.unpacked import copies
from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.lengths import MAX_DECLARED
from recorders.messages.record import RecordedMessage
from recorders.reading.raw_messages import FOREVER_NS

_MOST_MESSAGE = 2**28  # bytes
_MOST_TEXT = 2**20  # bytes of a definition
_MOST_TOPICS = 2**16
_LATEST_NS = 2**63  # sqlite's integers end there
_TABLES = ("topics", "messages")
_TOPICS = "SELECT id, name, type, serialization_format, offered_qos_profiles FROM topics ORDER BY id"
_OLD_TOPICS = "SELECT id, name, type, serialization_format, '' FROM topics ORDER BY id"
_MESSAGES = "SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ? AND timestamp <= ? ORDER BY "


class SqliteBag(ForeignReader):
    """Reader of one `.db3` file of any version of rosbag2.

    Messages that its recorder had not moved into the file yet, as a crash leaves them in a file `-wal` beside it, are
    read from a copy.

    Raises
    ------
    LogError
        If it is no such file. From every method: if it is damaged.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        journal = path.with_name(path.name + "-wal")
        has_more = journal.is_file() and journal.stat().st_size
        self._file = copies(path, journal) if has_more else path
        self._immutable = "" if has_more else "&immutable=1"
        with self._open() as connection:
            self._columns = {table: _columns(connection, table) for table in (*_TABLES, "message_definitions")}
        if not all(self._columns[table] for table in _TABLES):
            found = "an sqlite file without topics and messages in plain tables"
            raise LogError(f"{path}: expected a rosbag2 recording, found {found}")

    @cached_property
    def _by_number(self) -> dict[int, DeclaredChannel]:
        definitions = self._definitions()
        found: dict[int, DeclaredChannel] = {}
        with self._open(_MOST_TEXT) as connection:
            rows = connection.execute(_TOPICS if "offered_qos_profiles" in self._columns["topics"] else _OLD_TOPICS)
            for number, topic, kind, encoding, profiles in self._bounded(rows):
                metadata = (("offered_qos_profiles", str(profiles)),) if profiles else ()
                schema = str(kind), *definitions.get(kind, ("ros2msg", b""))
                found[number] = DeclaredChannel(str(topic), str(encoding), metadata, schema)
        return found

    def _definitions(self) -> dict[str, tuple[str, bytes]]:
        if not {"topic_type", "encoding", "encoded_message_definition"} <= self._columns["message_definitions"]:
            return {}
        with self._open() as connection:
            rows = connection.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions "
                "WHERE length(encoded_message_definition) <= ?",
                (_MOST_TEXT,),
            )
            return {kind: (str(encoding), str(text).encode()) for kind, encoding, text in self._bounded(rows)}

    def _bounded(self, rows: Iterable[tuple[Any, ...]]) -> Iterator[tuple[Any, ...]]:
        """Yield rows of texts and numbers as long as they are held in little memory."""
        held = 0
        for row in islice(rows, _MOST_TOPICS):
            held += sum(len(value) for value in row if isinstance(value, str | bytes))
            if held > MAX_DECLARED:
                raise LogError(f"{self.path}: more than {MAX_DECLARED} bytes of topics, the most that is held")
            yield row

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, with its schema; a version of rosbag2 that keeps no definitions leaves them empty."""
        return tuple(self._by_number.values())

    @cached_property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""
        found: dict[str, int] = {}
        with self._open() as connection:
            for number, count in connection.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"):
                if number in self._by_number:
                    topic = self._by_number[number].topic
                    found[topic] = found.get(topic, 0) + count
        return found

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`."""
        wanted = None if topics is None else frozenset(topics)
        chosen = {
            number: (channel.topic, channel.type)
            for number, channel in self._by_number.items()
            if wanted is None or channel.topic in wanted
        }
        with self._open() as connection:
            rows = connection.execute(
                _MESSAGES + ("id" if file_order else "timestamp, id"),
                (min(start_ns, _LATEST_NS - 1), min(end_ns, _LATEST_NS) - 1),
            )
            for number, time_ns, data in rows:
                named = chosen.get(number)
                if named is None:
                    if number in self._by_number:
                        continue
                    raise LogError(f"{self.path}: a message is of topic {number!r:.40}, which is not declared")
                if type(data) is not bytes or type(time_ns) is not int:
                    raise LogError(f"{self.path}: expected a time and bytes for each message, found others")
                yield RecordedMessage(*named, data, 0, time_ns)

    @contextmanager
    def _open(self, most: int = _MOST_MESSAGE) -> Iterator[sqlite3.Connection]:
        name = quote(os.fsencode(self._file.absolute()))
        try:
            with closing(sqlite3.connect(f"file:{name}?mode=ro{self._immutable}", uri=True)) as connection:
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, most)
                connection.execute("PRAGMA trusted_schema=OFF")
                yield connection
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise LogError(f"{self.path}: not a sound rosbag2 recording in sqlite: {error}") from None


def _columns(connection: sqlite3.Connection, table: str) -> set[str]:
    """Return the columns of a plain table; none of a view, nor of one with computed columns, which can be endless."""
    found = connection.execute("SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?", (table,)).fetchone()
    if found is None or not str(found[0]).upper().startswith("CREATE TABLE"):
        return set()
    columns = [(str(row[1]), row[6]) for row in connection.execute(f"PRAGMA table_xinfo({table})")]
    return set() if any(is_hidden for _, is_hidden in columns) else {name for name, _ in columns}
