"""The MCAP reader: messages of a log in the order of the file, lazily, and what the log says of itself."""

import os
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode

from recorders.errors import LogError
from recorders.manifest import METADATA_NAME, from_metadata
from recorders.mcap_contents import Channels, Contents, read_attachment, read_contents, read_metadata
from recorders.mcap_records import MAGIC, Record, chunk_data, damaged, read_all
from recorders.records import Stamped

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_HEAD = struct.Struct("<BQ")
_FIELDS_SIZE = _MESSAGE.size - _HEAD.size
_new_tuple = tuple.__new__  # a named tuple's own constructor takes twice as long


class LogReader:
    """Reads one log; opens the file for each use and keeps nothing but its table of contents.

    Parameters
    ----------
    path : path
        An MCAP file of any writer: chunked or not, lz4, zstd or uncompressed. Messages that are not CDR come with
        their bytes as they are and the name of their schema as type.

    Raises
    ------
    LogError
        If there is no such file or it is not MCAP. From the properties and from `attachment`: if the log is cut off
        or damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if self.path.is_dir():
            raise LogError(f"{self.path}: expected an MCAP file, found a directory")
        with self._open() as file:
            magic = file.read(len(MAGIC))
        if not magic:
            raise LogError(f"{self.path}: expected an MCAP file, found an empty one")
        if magic != MAGIC:
            raise LogError(f"{self.path}: expected an MCAP file, found one that begins with {magic!r}")

    def __iter__(self) -> Iterator[Stamped]:
        return self.records()

    def records(self, *, topics: Iterable[str] | None = None) -> Iterator[Stamped]:
        """Yield the messages in file order, holding one chunk at a time.

        Parameters
        ----------
        topics : iterable of str, optional
            Yield those on these topics only.

        Raises
        ------
        LogError
            If the log is cut off or damaged, after yielding every message before that.
        """
        wanted = None if topics is None else frozenset(topics)
        return self._records(Channels(), wanted, lambda record: None)

    @property
    def manifest(self) -> dict[str, Any]:
        """What made the log, as its writer was told; empty for a log of another writer."""
        offset = self._contents.metadata.get(METADATA_NAME)
        if offset is None:
            return {}
        with self._open() as file:
            return from_metadata(read_metadata(file, offset))

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""
        return dict(self._contents.channels.topics.values())

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic."""
        return dict(self._contents.counts)

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments."""
        return tuple(self._contents.attachments)

    def attachment(self, name: str) -> bytes:
        """Return an attachment; raises LogError, naming those that exist, if the log has none of this name."""
        offset = self._contents.attachments.get(name)
        if offset is None:
            exist = ", ".join(self.attachments) or "none"
            raise LogError(f"{self.path}: no attachment {name!r}; there are: {exist}")
        with self._open() as file:
            return read_attachment(file, offset)

    @cached_property
    def _contents(self) -> Contents:
        with self._open() as file:
            contents = read_contents(file)
        return contents or self._contents_by_reading()

    def _contents_by_reading(self) -> Contents:
        contents = Contents()
        records = self._records(contents.channels, None, contents.learn)
        contents.counts = Counter(record.topic for record in records)
        return contents

    def _records(
        self, channels: Channels, wanted: frozenset[str] | None, notice: Callable[[Record], None]
    ) -> Iterator[Stamped]:
        with self._open() as file:
            size = os.fstat(file.fileno()).st_size
            for record in read_all(file, size):
                if record.opcode == Opcode.CHUNK:
                    yield from _messages(chunk_data(record), channels, wanted, record.offset)
                elif record.opcode == Opcode.MESSAGE:
                    whole = _HEAD.pack(record.opcode, len(record.body)) + record.body
                    yield from _messages(whole, channels, wanted, record.offset)
                else:
                    channels.learn(record)
                    notice(record)

    @contextmanager
    def _open(self) -> Iterator[BinaryIO]:
        try:
            with self.path.open("rb") as file:
                yield file
        except FileNotFoundError:
            raise LogError(f"{self.path}: no such file") from None
        except OSError as error:
            raise LogError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        except LogError as error:
            raise LogError(f"{self.path}: {error}") from None


def _messages(data: bytes, channels: Channels, wanted: frozenset[str] | None, offset: int) -> Iterator[Stamped]:
    """Yield the messages among the records in `data`, which stands at `offset` in the file (in a chunk)."""
    topics = channels.topics
    place, end = 0, len(data)
    while place < end:
        if end - place >= _MESSAGE.size:
            opcode, length, channel, sequence, log_time_ns, _ = _MESSAGE.unpack_from(data, place)
        elif end - place >= _HEAD.size:
            opcode, length = _HEAD.unpack_from(data, place)
        else:
            raise damaged(offset, "its last record is cut off")
        start = place + _HEAD.size
        place = start + length
        if place > end:
            raise damaged(offset, "a record is longer than what holds it")
        if opcode != Opcode.MESSAGE:
            channels.learn(Record(opcode, offset, data[start:place]))
            continue
        if length < _FIELDS_SIZE:
            raise damaged(offset, "a message is too short")
        if channel not in topics:
            raise damaged(offset, f"a message is on channel {channel}, which was not declared")
        topic, kind = topics[channel]
        if wanted is None or topic in wanted:
            yield _new_tuple(Stamped, (topic, kind, data[start + _FIELDS_SIZE : place], sequence, log_time_ns))
