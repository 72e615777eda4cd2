"""A small log that holds every kind of record, put together record by record, and what a reader must find in it."""

import zlib
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from recorders.mcap_format.manifest import FORMAT_VERSION, METADATA_NAME, to_metadata
from recorders.mcap_format.records import MAGIC
from recorders.messages.record import RecordedMessage

COMPRESSIONS = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor().compress}
MANIFEST = {"format_version": FORMAT_VERSION, "robot": "none", "seed": 7}
ATTACHMENT = b"<robot name='none'/>"
SCHEMA = Schema(id=1, name="std_msgs/msg/String", encoding="ros2msg", data=b"string data\n")
PER_CHUNK = 5
BESIDE = 3  # messages outside of chunks
PRIVATE = b"\x90\x05\x00\x00\x00\x00\x00\x00\x00other"  # a record of another program's own
FOOTER_BODY = 20


@dataclass
class EveryRecord:
    """The log under construction, with or without CRCs."""

    crcs: bool = True
    raw: bytearray = field(default_factory=lambda: bytearray(MAGIC))
    truth: list[RecordedMessage] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    indexes: dict[Opcode, list[McapRecord]] = field(default_factory=dict)

    def add(self, *records: McapRecord) -> int:
        """Add records and return where the first one stands."""
        offset = len(self.raw)
        self.raw += packed(*records)
        return offset

    def crc(self, data: bytes, begin: int = 0) -> int:
        """Return the CRC of some data, 0 for none."""
        return zlib.crc32(data, begin) if self.crcs else 0

    def attachment(self) -> None:
        """Add an attachment."""
        offset = self.add(Attachment(3, 4, "robot.urdf", "application/xml", ATTACHMENT))
        if not self.crcs:
            self.raw[-4:] = bytes(4)
        entry = AttachmentIndex(offset, len(self.raw) - offset, 4, 3, len(ATTACHMENT), "robot.urdf", "application/xml")
        self.indexes[Opcode.ATTACHMENT_INDEX] = [entry]

    def message(self) -> Message:
        """Return the next message, on the channel declared last, and remember it as true."""
        index, channel = len(self.truth), self.channels[-1]
        time_ns = 10**9 + (index ^ 1) * 10**7  # not in order
        self.truth.append(
            RecordedMessage(channel.topic, SCHEMA.name, b"message %d" % index * (index % 4), index, time_ns)
        )
        return Message(channel.id, time_ns, self.truth[-1].data, time_ns, index)

    def channel(self) -> Channel:
        """Declare the next channel."""
        number = len(self.channels) + 1
        self.channels.append(Channel(number, f"/topic/{number}", "cdr", {"key": "value"}, SCHEMA.id))
        return self.channels[-1]

    def chunk(self, compression: str) -> None:
        """Add a chunk with its message index."""
        declared = packed(SCHEMA, self.channel())
        messages = [self.message() for _ in range(PER_CHUNK)]
        times = [message.log_time for message in messages]
        data = declared + packed(*messages)
        squeezed = COMPRESSIONS[compression](data)
        offset = self.add(Chunk(compression, squeezed, max(times), min(times), self.crc(data), len(data)))
        places = [len(declared) + len(packed(*messages[:count])) for count in range(PER_CHUNK)]
        channel = self.channels[-1].id
        end = self.add(MessageIndex(channel, list(zip(times, places, strict=True))))
        index = ChunkIndex(
            chunk_length=end - offset,
            chunk_start_offset=offset,
            compression=compression,
            compressed_size=len(squeezed),
            message_end_time=max(times),
            message_index_length=len(self.raw) - end,
            message_index_offsets={channel: end},
            message_start_time=min(times),
            uncompressed_size=len(data),
        )
        self.indexes.setdefault(Opcode.CHUNK_INDEX, []).append(index)

    def statistics(self) -> Statistics:
        """Return the numbers of everything."""
        counts: dict[int, int] = {channel.id: 0 for channel in self.channels}
        for record in self.truth:
            counts[int(record.topic.rpartition("/")[2])] += 1
        times = [record.log_time_ns for record in self.truth]
        return Statistics(
            1, len(self.channels), counts, len(COMPRESSIONS), len(self.truth), max(times), min(times), 1, 1
        )

    def finish(self) -> None:
        """Add data end, summary, footer and magic."""
        self.add(DataEnd(self.crc(bytes(self.raw))))
        start, offsets = len(self.raw), []
        groups: dict[Opcode, list[McapRecord]] = {
            Opcode.SCHEMA: [SCHEMA],
            Opcode.CHANNEL: [*self.channels],
            Opcode.STATISTICS: [self.statistics()],
        }
        for opcode, records in {**groups, **self.indexes}.items():
            group = self.add(*records)
            offsets.append(SummaryOffset(opcode, group, len(self.raw) - group))
        offsets_start = self.add(*offsets)
        head = packed(Footer(start, offsets_start, 0))[:-4]
        crc = self.crc(head, self.crc(bytes(self.raw[start:])))
        self.add(Footer(start, offsets_start, crc))
        self.raw += MAGIC


def packed(*records: McapRecord) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    found: bytes = builder.end()  # type: ignore[no-untyped-call]
    return found


def write_every_record(path: Path, *, crcs: bool = True) -> list[RecordedMessage]:
    """Write such a log and return its messages in the order of the file."""
    log = EveryRecord(crcs)
    log.add(Header("ros2", "by hand"))
    log.attachment()
    for compression in COMPRESSIONS:
        log.chunk(compression)
    log.raw += PRIVATE
    log.add(SCHEMA, log.channel())
    log.add(*(log.message() for _ in range(BESIDE)))
    offset = log.add(Metadata(METADATA_NAME, to_metadata(MANIFEST)))
    log.indexes[Opcode.METADATA_INDEX] = [MetadataIndex(offset, len(log.raw) - offset, METADATA_NAME)]
    log.finish()
    path.write_bytes(log.raw)
    return log.truth
