"""The one writer of MCAP: the library's, and a way past its buffers, which hold a record several times."""

import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Schema
from mcap.writer import CompressionType, Writer

from recorders.mcap_format.attachments import AttachmentHead
from recorders.mcap_format.chunk_contents import MESSAGE
from recorders.mcap_format.records import CRC, HEAD
from recorders.mcap_format.unread import Unread
from recorders.writing.chunk_index_file import ChunkIndexFile

_SIZE = struct.Struct("<Q")
_CHUNK = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression's name
_INDEX = struct.Struct("<HI")  # channel, bytes of its entries
_INDEX_ENTRY = 16  # bytes: time and place of a message
_PACK: dict[str, Callable[[bytes], bytes]] = {
    "": lambda data: data,
    "lz4": lz4.frame.compress,
    "zstd": lambda data: zstandard.ZstdCompressor().compress(data),
}

COMPRESSIONS = tuple(_PACK)
"""Compressions of chunks; an empty name stands for none."""


class BuiltChunk(NamedTuple):
    """The content of a chunk.

    Attributes
    ----------
    data : bytes
        Records of messages.
    times_ns : pair of int
        Log time of the earliest and the latest [ns].
    indexes : dict of bytes
        By channel, time and place in `data` of each of its messages, in order of time.
    """

    data: bytes
    times_ns: tuple[int, int]
    indexes: dict[int, bytes]


class McapWriter:
    """Writes MCAP with every CRC; attachments, and messages if asked for, go to the file in pieces, beside the chunks.

    Parameters
    ----------
    file : binary file
        Empty, and buffered: the library leaves a truncated file on an unbuffered one.
    profile : str
        What the log's messages are meant for.
    chunk_size : int
        Where a chunk ends at the latest [bytes].
    index : ChunkIndexFile, optional
        Takes the chunks' index, which grows with the log; memory, if left out.

    Raises
    ------
    OSError
        From every method but the two that register, if the file cannot be written.
    """

    def __init__(
        self, file: BinaryIO, *, profile: str = "ros2", chunk_size: int = 2**20, index: ChunkIndexFile | None = None
    ) -> None:
        self._file = file
        # Any: the library claims to be typed, and annotates but half of its methods
        self._mcap: Any = Writer(file, compression=CompressionType.LZ4, chunk_size=chunk_size, enable_data_crcs=True)
        if index is not None:
            setattr(self._mcap, _private("chunk_indices"), index)
        self._mcap.start(profile=profile, library="reenact")
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; returns its number."""
        number: int = self._mcap.register_schema(name, encoding, data)
        self._schemas[number] = Schema(id=number, name=name, encoding=encoding, data=data)
        return number

    def register_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Declare a channel; returns its number."""
        number: int = self._mcap.register_channel(topic, encoding, schema, dict(metadata))
        self._channels[number] = Channel(
            id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=dict(metadata)
        )
        return number

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._mcap.add_metadata(name, dict(texts))

    def add_message(self, channel: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Write a message into the chunk."""
        self._mcap.add_message(channel, log_time_ns, data, publish_time_ns, sequence)

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
        self._mcap.flush()
        self.declare(channel)
        head = MESSAGE.pack(channel, sequence, log_time_ns, publish_time_ns)
        size = len(head) + len(data) + (rest.size if rest else 0)
        self._write((HEAD.pack(Opcode.MESSAGE, size), head, data))
        self._write(rest.pieces() if rest else ())
        self._count(channel, log_time_ns)

    def add_chunk(self, chunk: BuiltChunk, compression: str) -> None:
        """Write a whole chunk with its message indexes, whose channels are declared before it."""
        packed = _PACK[compression](chunk.data)
        name = compression.encode()
        head = _CHUNK.pack(*chunk.times_ns, len(chunk.data), zlib.crc32(chunk.data), len(name))
        head += name + _SIZE.pack(len(packed))
        offset, length = self._file.tell(), HEAD.size + len(head) + len(packed)
        self._write((HEAD.pack(Opcode.CHUNK, len(head) + len(packed)), head, packed))
        places, place = dict[int, int](), offset + length
        for channel, entries in chunk.indexes.items():
            places[channel] = place
            body = _INDEX.pack(channel, len(entries)) + entries
            self._write((HEAD.pack(Opcode.MESSAGE_INDEX, len(body)), body))
            place += HEAD.size + len(body)
            self._count_all(channel, len(entries) // _INDEX_ENTRY, chunk.times_ns)
        self._of_library("statistics").chunk_count += 1
        self._of_library("chunk_indices").append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=compression,
                compressed_size=len(packed),
                message_end_time=chunk.times_ns[1],
                message_index_length=place - offset - length,
                message_index_offsets=places,
                message_start_time=chunk.times_ns[0],
                uncompressed_size=len(chunk.data),
            )
        )

    def add_attachment(self, head: AttachmentHead, data: Iterable[bytes | memoryview]) -> None:
        """Write an attachment; `start` of its head counts for nothing."""
        self._mcap.flush()
        name, media_type = head.name.encode(), head.media_type.encode()
        texts = b"".join(CRC.pack(len(text)) + text for text in (name, media_type))
        fields = _SIZE.pack(head.log_time_ns) + _SIZE.pack(head.create_time_ns) + texts + _SIZE.pack(head.size)
        size = len(fields) + head.size + CRC.size
        offset = self._file.tell()
        self._write([HEAD.pack(Opcode.ATTACHMENT, size)])
        crc = self._write(data, self._write([fields]))
        self._write([CRC.pack(crc)])
        self._of_library("statistics").attachment_count += 1
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

    def finish(self) -> None:
        """Write the summary, as the last thing of all."""
        self._mcap.finish()

    def flush(self) -> None:
        """End the chunk."""
        self._mcap.flush()

    def declare(self, channel: int) -> None:
        """Write the declaration of a channel, which may be in a chunk that is not written yet, beside the chunks."""
        builder: Any = RecordBuilder()
        declared = self._channels[channel]
        if declared.schema_id:
            self._schemas[declared.schema_id].write(builder)
        declared.write(builder)
        self._write([builder.end()])

    def _count(self, channel: int, log_time_ns: int) -> None:
        self._count_all(channel, 1, (log_time_ns, log_time_ns))

    def _count_all(self, channel: int, count: int, times_ns: tuple[int, int]) -> None:
        statistics = self._of_library("statistics")
        first = statistics.message_start_time if statistics.message_count else times_ns[0]
        statistics.message_start_time = min(first, times_ns[0])
        statistics.message_end_time = max(statistics.message_end_time, times_ns[1])
        statistics.channel_message_counts[channel] += count
        statistics.message_count += count

    def _write(self, pieces: Iterable[bytes | memoryview], crc: int = 0) -> int:
        """Write to the file what the library then has as its own; returns the CRC of it and what came before."""
        of_section = self._of_library("data_section_crc")
        for piece in pieces:
            self._file.write(piece)
            of_section, crc = zlib.crc32(piece, of_section), zlib.crc32(piece, crc)
        setattr(self._mcap, _private("data_section_crc"), of_section)
        return crc

    def _of_library(self, name: str) -> Any:
        return getattr(self._mcap, _private(name))


def _private(name: str) -> str:
    """Return what an attribute that the library keeps to itself is called: it has no way to write in pieces."""
    return f"_{Writer.__name__}__{name}"
