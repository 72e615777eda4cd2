"""Writes messages that are all there already, many at a time; a conversion is begun anew after a crash."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.lengths import LARGE
from recorders.mcap_format.manifest import FRAME, METADATA_NAME, ContentHash, to_metadata, topic_frame
from recorders.mcap_format.records import HEAD
from recorders.messages.record import RecordedMessage, publish_time_ns
from recorders.writing.chunk_encoder import RECORD, RECORD_SIZE, BuiltChunk
from recorders.writing.mcap_writer import McapWriter

_BODY = RECORD_SIZE - HEAD.size  # bytes of a message's body before its data
_OPCODE = int(Opcode.MESSAGE)
_ENTRY = np.dtype([("time", "<u8"), ("place", "<u8")])


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
        self._frames = {topic: topic_frame(channel.topic) for topic, channel in channels.items()}
        self._any = False
        self._content = ContentHash()
        self.counts: Counter[str] = Counter()

    def write(self, records: Iterator[RecordedMessage], *, end_ns: int, most_bytes: int) -> RecordedMessage | None:
        """Write messages up to a log time [ns] or until the file has a size [bytes]; at least one in any case.

        Returns
        -------
        RecordedMessage or None
            The first that is not written any more.
        """
        pack, hash_pack, numbers, frames = RECORD.pack, FRAME.pack, self._numbers, self._frames
        batch, size = _new_batch(), 0
        heads, hashed, data_of, times_ns, channels = batch
        for record in records:
            topic, _, data, sequence, time_ns = record
            length = len(data)
            if (time_ns >= end_ns and self._any) or length > LARGE:
                self._end_chunk(batch)
                if time_ns >= end_ns and self._any:
                    return record
                self._write_large(record)
                batch, size = _new_batch(), 0
                heads, hashed, data_of, times_ns, channels = batch
                if self._file.tell() >= most_bytes:
                    return next(records, None)
                continue
            self._any = True
            number = numbers[topic]
            published_ns = time_ns if type(record) is RecordedMessage else publish_time_ns(record)
            heads.append(pack(_OPCODE, length + _BODY, number, sequence, time_ns, published_ns))
            hashed.append(frames[topic] + hash_pack(sequence, time_ns, length))
            data_of.append(data)
            times_ns.append(time_ns)
            channels.append(number)
            size += length + RECORD_SIZE
            if size >= self._chunk_bytes:
                self._end_chunk(batch)
                batch, size = _new_batch(), 0
                heads, hashed, data_of, times_ns, channels = batch
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
        self.log.flush()  # what the library has written of the header goes first
        for number in declared.values():
            self.log.declare(number)
        return {topic: declared[channel] for topic, channel in channels.items()}

    def _end_chunk(self, batch: "_Batch") -> None:
        if not batch.data:
            return
        for number, count in Counter(batch.channels).items():
            self.counts[self._names[number]] += count
        self._content.add_framed(_interleaved(batch.hashed, batch.data))
        times = np.array(batch.times_ns, dtype=np.uint64)
        chunk = BuiltChunk(
            b"".join(_interleaved(batch.heads, batch.data)),
            (int(times.min()), int(times.max())),
            _indexes(batch, times),
        )
        self.log.add_chunk(chunk, self._compression)
        self._on_chunk(self.counts.total())

    def _write_large(self, record: RecordedMessage) -> None:
        """Write a message beside the chunks, which readers hold whole."""
        self._any = True
        number = self._numbers[record.topic]
        self.counts[self._names[number]] += 1
        self._content.add(self._names[number], record.sequence, record.log_time_ns, record.data)
        self.log.add_message_in_pieces(
            number, record.sequence, record.log_time_ns, publish_time_ns(record), record.data
        )
        self._on_chunk(self.counts.total())


class _Batch(NamedTuple):
    """The messages of a chunk, column by column, so that nothing of them is tracked by the garbage collector."""

    heads: list[bytes]
    hashed: list[bytes]
    data: list[bytes]
    times_ns: list[int]
    channels: list[int]


def _new_batch() -> _Batch:
    return _Batch([], [], [], [], [])


def _interleaved(heads: list[bytes], data: list[bytes]) -> list[bytes]:
    pieces = [b""] * (2 * len(data))
    pieces[::2], pieces[1::2] = heads, data
    return pieces


def _indexes(batch: _Batch, times: NDArray[np.uint64]) -> dict[int, bytes]:
    """Return the entries of the message index of each channel, in order of time."""
    channels = np.array(batch.channels)
    ends = np.cumsum(np.fromiter(map(len, batch.data), np.int64, len(batch.data)) + RECORD_SIZE)
    entries = np.zeros(len(channels), _ENTRY)
    entries["time"], entries["place"][1:] = times, ends[:-1]
    found = {}
    for number in np.unique(channels).tolist():
        of_channel = entries[channels == number]
        found[number] = of_channel[np.argsort(of_channel["time"], kind="stable")].tobytes()
    return found
