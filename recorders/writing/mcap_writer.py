"""The one writer of MCAP: the library's, with chunks encoded here, and a way past its buffers for large records."""

import struct
import sys
import zlib
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Schema
from mcap.writer import CompressionType, Writer

from recorders.mcap_format.attachments import AttachmentHead
from recorders.mcap_format.chunk_contents import MESSAGE, MessageColumns, Pending
from recorders.mcap_format.records import CRC, HEAD
from recorders.mcap_format.unread import Unread
from recorders.writing.chunk_encoder import RECORD_SIZE, BuiltChunk, build_chunk, encode_chunk
from recorders.writing.chunk_index_file import ChunkIndexFile, EncodedRecords

_SIZE = struct.Struct("<Q")


class McapWriter:
    """Writes MCAP with every CRC; attachments, and messages if asked for, go to the file in pieces, beside the chunks.

    Parameters
    ----------
    file : binary file
        Empty, and buffered: the library leaves a truncated file on an unbuffered one.
    profile : str
        What the log's messages are meant for.
    chunk_size : int
        A chunk ends with the record that makes it longer than this, before it is compressed [bytes].
    chunk_messages : int
        A chunk ends with every message whose number in the file is a multiple of this.
    index : ChunkIndexFile, optional
        Takes the chunks' index, which grows with the log; memory, if left out.
    on_chunk : callable, optional
        Given the messages of each chunk that is written.

    Attributes
    ----------
    pending : list of Pending
        Messages of the chunk that is gathered.
    written : int
        Messages of the chunks that are written.

    Raises
    ------
    OSError
        From every method but the two that register, if the file cannot be written.
    """

    def __init__(
        self,
        file: BinaryIO,
        *,
        profile: str = "ros2",
        chunk_size: int = 2**20,
        chunk_messages: int = sys.maxsize,
        index: ChunkIndexFile | None = None,
        on_chunk: Callable[[MessageColumns], None] = lambda messages: None,
    ) -> None:
        self._on_chunk = on_chunk
        self._file = file
        # Any: the library claims to be typed, and annotates but half of its methods
        self._mcap: Any = Writer(file, compression=CompressionType.LZ4, chunk_size=chunk_size, enable_data_crcs=True)
        if index is not None:
            setattr(self._mcap, _private("chunk_indices"), index)
        self._statistics = self._of_library("statistics")
        self.pending: list[Pending] = []
        self.written = 0
        self._chunk_messages = self._room = chunk_messages
        self._declared: list[tuple[int, bytes]] = []  # schemas and channels, and how many messages stand before each
        self._gathered = 0  # size of everything so far [bytes]
        self._full = chunk_size  # the same, at which the chunk ends
        self._mcap.start(profile=profile, library="reenact")
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; returns its number."""
        number: int = self._mcap.register_schema(name, encoding, data)
        self._schemas[number] = Schema(id=number, name=name, encoding=encoding, data=data)
        self._declare_in_chunk()
        return number

    def register_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Declare a channel; returns its number."""
        number: int = self._mcap.register_channel(topic, encoding, schema, dict(metadata))
        self._channels[number] = Channel(
            id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=dict(metadata)
        )
        self._declare_in_chunk()
        return number

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self.end_chunk()
        self._mcap.add_metadata(name, dict(texts))

    def add_message(self, message: Pending) -> None:
        """Write a message into the chunk."""
        if self.gather(message):
            self.end_chunk()

    def gather(self, message: Pending) -> bool:
        """Take a message for the chunk; returns whether it is to be the chunk's last.

        One thread may call this while another calls anything else.
        """
        pending = self.pending
        pending.append(message)
        self._gathered += RECORD_SIZE + len(message[4])
        return len(pending) >= self._room or self._gathered > self._full

    def add_message_in_pieces(
        self,
        channel: int,
        sequence: int,
        log_time_ns: int,
        publish_time_ns: int,
        data: bytes,
        rest: Unread | None = None,
    ) -> None:
        """Write a message beside the chunks, of which a part may still be in another file."""
        self.end_chunk()
        self.declare(channel)
        head = MESSAGE.pack(channel, sequence, log_time_ns, publish_time_ns)
        size = len(head) + len(data) + (rest.size if rest else 0)
        self._write((HEAD.pack(Opcode.MESSAGE, size), head, data))
        self._write(rest.pieces() if rest else ())
        self._count({channel: 1}, log_time_ns, log_time_ns)

    def add_chunk(self, chunk: BuiltChunk, compression: str = "lz4") -> None:
        """Write a whole chunk with its message indexes, whose channels are declared before it or in it."""
        records, index = encode_chunk(chunk, compression, self._file.tell())
        self._write([records])
        self._of_library("chunk_indices").append(EncodedRecords(index))
        self._statistics.chunk_count += 1
        self._count(chunk.counts, *chunk.times_ns)

    def add_attachment(self, head: AttachmentHead, data: Iterable[bytes | memoryview]) -> None:
        """Write an attachment; `start` of its head counts for nothing."""
        self.end_chunk()
        name, media_type = head.name.encode(), head.media_type.encode()
        texts = b"".join(CRC.pack(len(text)) + text for text in (name, media_type))
        fields = _SIZE.pack(head.log_time_ns) + _SIZE.pack(head.create_time_ns) + texts + _SIZE.pack(head.size)
        size = len(fields) + head.size + CRC.size
        offset = self._file.tell()
        self._write([HEAD.pack(Opcode.ATTACHMENT, size)])
        self._write([fields])
        crc = zlib.crc32(fields)
        for piece in data:
            self._write([piece])
            crc = zlib.crc32(piece, crc)
        self._write([CRC.pack(crc)])
        self._statistics.attachment_count += 1
        self._of_library("attachment_indexes").append(
            AttachmentIndex(
                offset=offset,
                length=HEAD.size + size,
                create_time=head.create_time_ns,
                log_time=head.log_time_ns,
                data_size=head.size,
                name=head.name,
                media_type=head.media_type,
            )
        )

    @property
    def messages(self) -> int:
        """Messages of all chunks so far."""
        return self.written + len(self.pending)

    @property
    def counts(self) -> Mapping[int, int]:
        """Messages by channel, of the chunks that are written and beside them."""
        found: Mapping[int, int] = self._statistics.channel_message_counts
        return found

    def finish(self) -> None:
        """Write the summary, as the last thing of all."""
        self.end_chunk()
        self._mcap.finish()

    def end_chunk(self) -> bool:
        """Write the chunk that is gathered, and return whether there was one; declarations alone wait for the next."""
        taken = self.pending[:]
        if not taken:
            return False
        self.written += len(taken)
        self._room = self._chunk_messages - self.written % self._chunk_messages
        del self.pending[: len(taken)]  # one more may have come meanwhile
        declared, self._declared = self._declared, []
        messages = MessageColumns.of(taken)
        self._on_chunk(messages)
        chunk = build_chunk(messages, declared)
        self._full += len(chunk.data)
        self.add_chunk(chunk)
        return True

    def _declare_in_chunk(self) -> None:
        """Take the declaration that the library has just put into a chunk of its own into this one."""
        record: bytes = self._of_library("chunk_builder").end()
        self._declared.append((len(self.pending), record))
        self._gathered += len(record)
        if self._gathered > self._full:
            self.end_chunk()

    def declare(self, channel: int) -> None:
        """Write the declaration of a channel, which may be in a chunk that is not written yet, beside the chunks."""
        builder: Any = RecordBuilder()
        declared = self._channels[channel]
        if declared.schema_id:
            self._schemas[declared.schema_id].write(builder)
        declared.write(builder)
        self._write([builder.end()])

    def _count(self, counts: Mapping[int, int], first_ns: int, last_ns: int) -> None:
        statistics = self._statistics
        first = statistics.message_start_time if statistics.message_count else first_ns
        statistics.message_start_time = min(first, first_ns)
        statistics.message_end_time = max(statistics.message_end_time, last_ns)
        for channel, count in counts.items():
            statistics.channel_message_counts[channel] += count
            statistics.message_count += count

    def _write(self, pieces: Iterable[bytes | memoryview]) -> None:
        """Write to the file what the library then has as its own."""
        crc = self._of_library("data_section_crc")
        for piece in pieces:
            self._file.write(piece)
            crc = zlib.crc32(piece, crc)
        setattr(self._mcap, _private("data_section_crc"), crc)

    def _of_library(self, name: str) -> Any:
        return getattr(self._mcap, _private(name))


@cache  # for every chunk the same few
def _private(name: str) -> str:
    """Return what an attribute that the library keeps to itself is called: it has no way to write in pieces."""
    return f"_{Writer.__name__}__{name}"
