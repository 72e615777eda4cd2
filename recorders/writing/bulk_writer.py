"""Writes messages that are all there already, many at a time; a conversion is begun anew after a crash."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import BinaryIO

import numpy as np

from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.mcap_format.lengths import LARGE
from recorders.mcap_format.manifest import METADATA_NAME, ContentHash, to_metadata, topic_frame
from recorders.messages.record import RecordedMessage, publish_time_ns
from recorders.writing.chunk_encoder import RECORD_SIZE, BuiltChunk, message_records
from recorders.writing.mcap_writer import McapWriter

_ENTRY = np.dtype([("time", "<u8"), ("place", "<u8")])  # of a message index


class BulkWriter:
    """Writes one MCAP file of messages in the order in which they come.

    Parameters
    ----------
    file : binary file
        Empty, and buffered.
    profile : str
        What the messages are meant for.
    channels : mapping of str to DeclaredChannel
        The channel, under the name that it gets, of every topic that comes.
    compression : str
        `lz4`, `zstd` or an empty string for none.
    chunk_bytes : int
        Where a chunk ends [bytes].
    on_chunk : callable
        Called with the number of messages written so far, after each chunk and each large message.

    Attributes
    ----------
    log : McapWriter
        What writes the file, for attachments and metadata before the messages or behind them.
    counts : Counter
        Number of messages by the name of the topic in the file.

    Raises
    ------
    OSError
        From every method, if the file cannot be written.
    """

    def __init__(
        self,
        file: BinaryIO,
        channels: Mapping[str, DeclaredChannel],
        *,
        profile: str,
        compression: str = "lz4",
        chunk_bytes: int = 2**20,
        on_chunk: Callable[[int], None] = lambda count: None,
    ) -> None:
        self._file = file
        self.log = McapWriter(file, profile=profile)
        self._compression, self._chunk_bytes, self._on_chunk = compression, chunk_bytes, on_chunk
        self._numbers = self._declare(channels)
        self._names = {self._numbers[topic]: channel.topic for topic, channel in channels.items()}
        self._frames = {number: topic_frame(topic) for number, topic in self._names.items()}
        self._content = ContentHash()
        self.counts: Counter[str] = Counter()

    def write(self, records: Iterator[RecordedMessage], *, end_ns: int, most_bytes: int) -> RecordedMessage | None:
        """Write messages up to a log time [ns] or until the file has a size [bytes]; at least one in any case.

        Returns
        -------
        RecordedMessage or None
            The first that is not written any more.
        """
        numbers, chunk_bytes = self._numbers, self._chunk_bytes
        batch, size = _Batch(), 0
        for record in records:
            topic, _, data, sequence, time_ns = record
            length = len(data)
            is_over = time_ns >= end_ns and bool(batch.data or self.counts)
            if is_over or length > LARGE:
                self._end_chunk(batch)
                if is_over:
                    return record
                self._write_large(record)
            else:
                batch.channels.append(numbers[topic])
                batch.sequences.append(sequence)
                batch.log_times_ns.append(time_ns)
                batch.publish_times_ns.append(time_ns if type(record) is RecordedMessage else publish_time_ns(record))
                batch.data.append(data)
                size += length + RECORD_SIZE
                if size < chunk_bytes:
                    continue
                self._end_chunk(batch)
            batch, size = _Batch(), 0
            if self._file.tell() >= most_bytes:
                return next(records, None)
        self._end_chunk(batch)
        return None

    def finish(self, manifest: Mapping[str, object]) -> None:
        """Write the manifest and the summary; `messages`, `counts` and `content_sha256` are added."""
        outcome = {
            "messages": self.counts.total(),
            "counts": dict(self.counts),
            "content_sha256": self._content.hexdigest(),
        }
        self.log.add_metadata(METADATA_NAME, to_metadata({**manifest, **outcome}))
        self.log.finish()

    def _declare(self, channels: Mapping[str, DeclaredChannel]) -> dict[str, int]:
        """Write all channels and their schemas; returns their numbers by topic as it comes."""
        schemas: dict[tuple[str, str, bytes], int] = {}
        declared: dict[DeclaredChannel, int] = {}
        for channel in dict.fromkeys(channels.values()):
            schema = 0  # MCAP's number for no schema
            if channel.schema is not None:
                schema = schemas.get(channel.schema) or self.log.register_schema(*channel.schema)
                schemas[channel.schema] = schema
            declared[channel] = self.log.register_channel(
                channel.topic, channel.encoding, schema, dict(channel.metadata)
            )
        for number in declared.values():
            self.log.declare(number)
        return {topic: declared[channel] for topic, channel in channels.items()}

    def _end_chunk(self, batch: "_Batch") -> None:
        if not batch.data:
            return
        messages = batch.columns()
        for number, count in Counter(messages.channels).items():
            self.counts[self._names[number]] += count
        self._content.add_all(self._frames, messages)
        times = messages.log_times_ns
        chunk = BuiltChunk(b"".join(message_records(messages)), (min(times), max(times)), _indexes(messages))
        self.log.add_chunk(chunk, self._compression)
        self._on_chunk(self.counts.total())

    def _write_large(self, record: RecordedMessage) -> None:
        """Write a message beside the chunks, which readers hold whole."""
        number = self._numbers[record.topic]
        self.counts[self._names[number]] += 1
        self._content.add(self._names[number], record.sequence, record.log_time_ns, record.data)
        self.log.add_message_in_pieces(
            number, record.sequence, record.log_time_ns, publish_time_ns(record), record.data
        )
        self._on_chunk(self.counts.total())


class _Batch:
    """The messages of a chunk, column by column, so that nothing of them is tracked by the garbage collector."""

    def __init__(self) -> None:
        self.channels: list[int] = []
        self.sequences: list[int] = []
        self.log_times_ns: list[int] = []
        self.publish_times_ns: list[int] = []
        self.data: list[bytes] = []

    def columns(self) -> MessageColumns:
        """Return them for the calls that go through many at once."""
        sizes = list(map(len, self.data))
        return MessageColumns(self.channels, self.sequences, self.log_times_ns, self.publish_times_ns, self.data, sizes)


def _indexes(messages: MessageColumns) -> dict[int, bytes]:
    """Return the entries of the message index of each channel, in order of time."""
    channels = np.array(messages.channels)
    ends = np.cumsum(np.array(messages.sizes) + RECORD_SIZE)
    entries = np.zeros(len(channels), _ENTRY)
    entries["time"], entries["place"][1:] = messages.log_times_ns, ends[:-1]
    found = {}
    for number in np.unique(channels).tolist():
        of_channel = entries[channels == number]
        found[number] = of_channel[np.argsort(of_channel["time"], kind="stable")].tobytes()
    return found
