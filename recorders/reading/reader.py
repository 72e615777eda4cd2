"""The MCAP reader: messages of a log in order of log time, lazily, with its manifest, metadata and attachments."""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Statistics

from recorders.errors import LogError, unreadable
from recorders.files.regular_file import require_regular_file
from recorders.mcap_format.attachments import check_attachment
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.crc_coverage import is_protected
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.manifest import METADATA_NAME, from_metadata
from recorders.mcap_format.records import MAGIC, RawRecord
from recorders.mcap_format.sections import record_at
from recorders.mcap_format.summary import ChannelTable, Contents, read_attachment, read_contents, read_metadata
from recorders.messages.record import RecordedMessage
from recorders.reading.file_kind import no_log_text
from recorders.reading.log_order import LogOrder, find_order
from recorders.reading.raw_messages import FOREVER_NS, WRONG_TIMES, MessageScanner
from recorders.reading.scan import LogScan
from recorders.reading.time_order import Pieces, merged
from recorders.text.wording import names_text

_NO_SKIPS: Mapping[int, int] = {}
_BY_FILE = LogOrder(by_file=True, risen=False)


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
        require_regular_file(self.path)
        with self._open() as file:
            magic = file.read(len(MAGIC))
        if magic != MAGIC:
            raise LogError(f"{self.path}: {no_log_text(magic)}")

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
        publish_times: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages in order of log time, undecoded; those of one time in the order of the file.

        A log of our own writer goes by the order of the file, whatever its times. Of a log in order one chunk is held
        at a time; where chunks overlap in time they are merged, and those that overlap are held.

        With a time, chunks of a log of our own writer that hold none of it by a verified summary are not read, and
        damage in them is not noticed then. What others state of times is not relied upon: such a log is looked through.

        Parameters
        ----------
        topics : iterable of str, optional
            Yield those on these topics only.
        start_ns, end_ns : int, optional
            Yield those of log time [start_ns, end_ns) only.
        file_order : bool
            Whether they come in the order of the file instead.
        publish_times : bool
            Whether those whose publish times are not their log times come as `PublishedMessage`.

        Raises
        ------
        DamagedLog
            If the log is cut off or damaged, after yielding every message before that.
        LogError
            If more of it overlaps in time than may be held, or its chunks are of other times than they state.
        """
        channels = ChannelTable(wanted=None if topics is None else frozenset(topics))
        walk = MessageScanner(channels, start_ns, end_ns, publish_times=publish_times)
        order = _BY_FILE if file_order else self._order
        if not order.by_file and (walk.sliced or not order.risen):
            return self._merged(walk)
        walk.ordered = not order.by_file
        skip_ranges = _NO_SKIPS
        if walk.sliced and self._order.by_file:
            skip_ranges = self._index.chunks.skip_ranges(walk.start_ns, walk.end_ns)
        return self._walk(walk, skip_ranges, lambda record: None)

    def by_log_time(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        publish_times: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages in order of log time, also of a log of our own writer; raises as `records` does."""
        channels = ChannelTable(wanted=None if topics is None else frozenset(topics))
        return self._merged(MessageScanner(channels, start_ns, end_ns, publish_times=publish_times))

    @property
    def protected(self) -> bool:
        """Whether CRCs cover every message and the summary, as they do in our logs.

        Of a log that is not protected a changed bit may go unnoticed. Finding out may take a look at the whole log.
        """
        with self._open() as file:
            return is_protected(file)

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest given to the log's writer; empty for a log of another writer."""
        entries = [entry for entry in self._contents.metadata if entry.name == METADATA_NAME]
        if not entries:
            return {}
        with self._open() as file:
            return from_metadata(read_metadata(file, entries[-1].offset))

    @property
    def metadata(self) -> tuple[tuple[str, dict[str, str]], ...]:
        """Name and content of every metadata record, in the order of the file; several may have one name."""
        with self._open() as file:
            return tuple((entry.name, read_metadata(file, entry.offset)) for entry in self._contents.metadata)

    @property
    def indexed(self) -> bool:
        """Whether it states its channels and counts at its end; else they take reading all of it."""
        return isinstance(self._summary, Contents)

    @property
    def by_file(self) -> bool:
        """Whether its messages go by the order of the file, whatever their log times: a log of our own writer."""
        return self._order.by_file

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""
        return dict(self._contents.channels.topics.values())

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel as it was declared, with its schema."""
        return tuple(self._contents.channels.declarations.channels.values())

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""
        return dict(+self._contents.counts)

    @property
    def statistics(self) -> Statistics | None:
        """What the log's summary states of times and numbers; None if it states nothing."""
        with self._open():
            return self._contents.statistics

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments, in the order of the file; several may have one name."""
        return tuple(entry.name for entry in self._contents.attachments)

    def attachment(self, name: str, *, which: int = -1) -> bytes:
        """Return an attachment.

        Parameters
        ----------
        name : str
            Its name.
        which : int
            Which one of several of that name, in the order of the file; the last by default.

        Raises
        ------
        LogError
            If the log has none of this name; the line names those that exist.
        """
        entries = [entry for entry in self._contents.attachments if entry.name == name]
        if not entries:
            exist = names_text(self.attachments) or "none"
            raise LogError(f"{self.path}: no attachment {name!r}; there are: {exist}")
        with self._open() as file:
            return read_attachment(file, entries[which].offset)

    @contextmanager
    def attachment_records(self) -> Iterator[Iterator[RawRecord]]:
        """Give the records of all attachments in the order of the file, each checked; what is large stays in the file.

        Raises
        ------
        DamagedLog
            If the CRC of one does not hold.
        """
        with self._open() as file:

            def checked() -> Iterator[RawRecord]:
                for entry in self._contents.attachments:
                    record = record_at(file, entry.offset, Opcode.ATTACHMENT)
                    check_attachment(record)
                    yield record

            yield checked()

    @cached_property
    def _summary(self) -> Contents | DamagedLog | None:
        """Contents of the summary section, or the damage in it; None if there is none to be used."""
        try:
            with self._open() as file:
                return read_contents(file)
        except DamagedLog as error:
            return error

    @property
    def _index(self) -> Contents:
        """Contents of the summary section if a CRC covers it, empty contents otherwise."""
        summary = self._summary
        return summary if isinstance(summary, Contents) and summary.crc_verified else Contents()

    @cached_property
    def _contents(self) -> Contents:
        if isinstance(self._summary, DamagedLog):
            raise self._summary.located(self.path)
        return self._summary or self._contents_by_reading()

    def _contents_by_reading(self) -> Contents:
        contents = Contents()
        records = self._walk(MessageScanner(contents.channels), _NO_SKIPS, contents.register)
        contents.counts = Counter(record.topic for record in records)
        return contents

    def _walk(
        self, walk: MessageScanner, skip_ranges: Mapping[int, int], on_record: Callable[[RawRecord], None]
    ) -> Iterator[RecordedMessage]:
        reached_ns = 0
        walk.channels.register_all(self._index.channels)
        with self._open() as file:
            try:
                for batch in LogScan(file, walk, self._index.chunks, skip_ranges).batches(on_record):
                    if batch and walk.ordered:
                        if batch[0].log_time_ns < reached_ns:
                            raise LogError(WRONG_TIMES)
                        reached_ns = batch[-1].log_time_ns
                    yield from batch
            except DamagedLog as error:
                last_ns = walk.last_time_ns  # of the chunk that was put in order: that of its last message in the file
                raise error.located(self.path, None if last_ns is None else max(last_ns, reached_ns)) from None

    @cached_property
    def _order(self) -> LogOrder:
        with self._open() as file:
            return find_order(file, os.fstat(file.fileno()).st_size, self._index)

    @cached_property
    def _pieces(self) -> Pieces:
        """Offsets of the messages of a log whose order is another than that of the file, up to the first damage."""
        pieces = Pieces()
        pieces.channels.register_all(self._index.channels)
        try:
            with self._open() as file:
                for _ in LogScan(file, pieces, self._index.chunks, _NO_SKIPS).batches(lambda record: None):
                    pass
        except DamagedLog as error:
            pieces.damage = error
        return pieces

    def _merged(self, walk: MessageScanner) -> Iterator[RecordedMessage]:
        pieces = self._pieces
        with self._open() as file:
            try:
                yield from merged(file, os.fstat(file.fileno()).st_size, pieces, walk)
            except DamagedLog as error:
                raise error.located(self.path, walk.last_time_ns) from None

    @contextmanager
    def _open(self) -> Iterator[BinaryIO]:
        try:
            with self.path.open("rb") as file:
                yield file
        except OSError as error:
            raise LogError(unreadable(self.path, error)) from error
        except DamagedLog as error:
            raise (error if error.path else error.located(self.path)) from None
        except LogError as error:
            raise LogError(f"{self.path}: {error}") from None
