"""What a log contains, from its summary section: topics, counts, chunks, and where metadata and attachments stand."""

import zlib
from collections import Counter
from dataclasses import dataclass, field
from io import SEEK_END
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from recorders.chunk_table import ChunkTable
from recorders.damage import damaged
from recorders.mcap_records import CRC, Record, parse, summary_records
from recorders.mcap_sections import check_data_section, read_footer, record_at


@dataclass
class Channels:
    """The channels met so far, and their schemas.

    Attributes
    ----------
    schemas : dict
        Name of a schema by its number.
    topics : dict
        Topic and type of a channel by its number.
    wanted : frozenset, optional
        Topics that are asked for; all if None.
    chosen : dict
        The same as `topics`, but None for a channel that is not asked for.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, str]] = field(default_factory=dict)
    wanted: frozenset[str] | None = None
    chosen: dict[int, tuple[str, str] | None] = field(default_factory=dict)

    def learn(self, record: Record) -> None:
        """Take in a schema or channel record, pass over any other; raises DamagedLog if it is malformed."""
        if record.opcode == Opcode.SCHEMA:
            schema = parse(Schema, record)
            self.schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            channel = parse(Channel, record)
            self._declare(channel.id, (channel.topic, self.schemas.get(channel.schema_id, "")))

    def learn_from(self, other: "Channels") -> None:
        """Take in the channels that another part of the log declares."""
        self.schemas.update(other.schemas)
        for channel, declared in other.topics.items():
            self._declare(channel, declared)

    def _declare(self, channel: int, declared: tuple[str, str]) -> None:
        self.topics[channel] = declared
        self.chosen[channel] = declared if self.wanted is None or declared[0] in self.wanted else None


@dataclass
class Contents:
    """What a log contains.

    Attributes
    ----------
    channels : Channels
        Every channel of the log.
    counts : Counter
        Number of messages by topic.
    metadata, attachments : dict
        Offset in the file [bytes] by name; of several of one name the last.
    chunks : ChunkTable
        Where the chunks stand.
    sound : bool
        Whether this is from a summary section that a CRC covers and that knows every channel and chunk.
    """

    channels: Channels = field(default_factory=Channels)
    counts: Counter[str] = field(default_factory=Counter)
    metadata: dict[str, int] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)
    chunks: ChunkTable = field(default_factory=ChunkTable)
    sound: bool = False

    def learn(self, record: Record) -> None:
        """Take in any record of a data or summary section; raises DamagedLog if it is malformed."""
        self.channels.learn(record)
        match record.opcode:
            case Opcode.CHUNK_INDEX:
                self.chunks.learn(record)
            case Opcode.METADATA_INDEX:
                metadata_index = parse(MetadataIndex, record)
                self.metadata[metadata_index.name] = metadata_index.offset
            case Opcode.ATTACHMENT_INDEX:
                attachment_index = parse(AttachmentIndex, record)
                self.attachments[attachment_index.name] = attachment_index.offset
            case Opcode.METADATA:
                self.metadata[parse(Metadata, record).name] = record.offset
            case Opcode.ATTACHMENT:
                self.attachments[parse(Attachment, record).name] = record.offset


def read_contents(file: BinaryIO) -> Contents | None:
    """Return what the summary section says, None for a file that was written without one, or with half of one.

    Raises
    ------
    DamagedLog
        If the file is cut off or its summary is damaged.
    """
    footer = read_footer(file)
    size = file.seek(0, SEEK_END)
    if footer.summary_start == 0:
        return None
    file.seek(footer.summary_start)
    contents = Contents()
    statistics = None
    for record in summary_records(file, size):
        contents.learn(record)
        if record.opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, record)
    if statistics is None or not _all_indexed(contents, statistics):
        return None
    for channel, (topic, _) in contents.channels.topics.items():
        contents.counts[topic] += statistics.channel_message_counts.get(channel, 0)
    whole = contents.chunks.ordered and len(contents.chunks) == statistics.chunk_count
    contents.sound = whole and bool(footer.summary_crc)
    return contents


def _all_indexed(contents: Contents, statistics: Statistics) -> bool:
    return (
        len(contents.channels.topics) == statistics.channel_count
        and bool(contents.metadata) == bool(statistics.metadata_count)
        and bool(contents.attachments) == bool(statistics.attachment_count)
    )


def read_metadata(file: BinaryIO, offset: int) -> dict[str, str]:
    """Return the metadata at `offset`; raises DamagedLog if there is none."""
    metadata: dict[str, str] = parse(Metadata, record_at(file, offset, Opcode.METADATA)).metadata
    return metadata


def read_attachment(file: BinaryIO, offset: int) -> bytes:
    """Return the attachment at `offset`; raises DamagedLog if there is none or its CRC does not hold."""
    record = record_at(file, offset, Opcode.ATTACHMENT)
    data: bytes = parse(Attachment, record).data
    if not check_attachment(record):
        check_data_section(file)
    return data


def check_attachment(record: Record) -> bool:
    """Return whether an attachment has a CRC of its own; raises DamagedLog if that does not hold."""
    if not attachment_has_crc(record):
        return False
    if record.body[-CRC.size :] != CRC.pack(zlib.crc32(memoryview(record.body)[: -CRC.size])):
        raise damaged(record.offset, "the CRC of an attachment does not hold")
    return True


def attachment_has_crc(record: Record) -> bool:
    """Whether an attachment has a CRC of its own: 0 means none."""
    return record.body[-CRC.size :] != bytes(CRC.size)
