"""The container rosbag2: a folder of files in sqlite or MCAP, which `metadata.yaml` names in order."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from itertools import chain
from pathlib import Path

from recorders.containers.foreign_reader import ForeignReader, all_counts
from recorders.containers.reader import Reader
from recorders.containers.sqlite_bag import SqliteBag
from recorders.containers.unpacked import unpack_zstd
from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.decompression import DECOMPRESS_ERRORS, decompress_frames
from recorders.messages.record import RecordedMessage, publish_time_ns, published
from recorders.reading.bag_metadata import read_bag_metadata
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import merged_by_time

_MOST_MESSAGE = 2**28  # bytes
_READERS: dict[str, Callable[[Path], Reader]] = {"sqlite3": SqliteBag, "mcap": LogReader}


class BagFolder(ForeignReader):
    """Reader of a rosbag2 folder whose files are in sqlite, or compressed as a whole or message by message.

    Raises
    ------
    LogError
        If a file that it names is missing, or it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        about = read_bag_metadata(path)
        if about.storage not in _READERS:
            known = " or ".join(_READERS)
            raise LogError(f"{path}: expected a bag stored as {known}, found {about.storage!r}; `ros2 bag convert` it")
        self._packed_messages = about.compression_mode == "message"
        packed_files = about.compression_mode == "file"
        self._files = {unpack_zstd(file) if packed_files else file: file for file in about.files}
        with self._named():
            self._parts = [_READERS[about.storage](file) for file in self._files]

    @cached_property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, with its schema."""
        with self._named():
            return tuple(dict.fromkeys(channel for part in self._parts for channel in part.channels))

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""
        with self._named():
            return all_counts([part.counts for part in self._parts])

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
        publish_times: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`."""
        wanted = None if topics is None else frozenset(topics)
        reads = [
            partial(
                partial(part.records, publish_times=publish_times) if isinstance(part, LogReader) else part.records,
                topics=wanted,
                start_ns=start_ns,
                end_ns=end_ns,
                file_order=file_order,
            )
            for part in self._parts
        ]
        found = chain.from_iterable(read() for read in reads) if file_order else merged_by_time(reads)
        with self._named():
            yield from map(self._unpacked, found) if self._packed_messages else found

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Have errors name the files of the folder in place of copies of them."""
        try:
            yield
        except LogError as error:
            text = str(error)
            for copy, file in self._files.items():
                text = text.replace(str(copy), str(file))
            raise LogError(text) from None

    def _unpacked(self, record: RecordedMessage) -> RecordedMessage:
        try:
            data = decompress_frames(record.data, _MOST_MESSAGE)
            return published(
                RecordedMessage(record.topic, record.type, data, record.sequence, record.log_time_ns),
                publish_time_ns(record),
            )
        except DECOMPRESS_ERRORS as error:
            raise LogError(f"{self.path}: a message of {record.topic} does not decompress: {error}") from None
