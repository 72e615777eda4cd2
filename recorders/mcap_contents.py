"""What a log contains, from its summary section: topics, counts, and where metadata and attachments stand."""

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from io import SEEK_END
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Footer, Metadata, MetadataIndex, Schema, Statistics

from recorders.errors import LogError
from recorders.mcap_records import FOOTER_SIZE, MAGIC, Record, cut_off, damaged, parse, read_record, read_summary


@dataclass
class Channels:
    """The channels met so far, and their schemas."""

    schemas: dict[int, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, str]] = field(default_factory=dict)  # topic and type by channel number

    def learn(self, record: Record) -> None:
        """Take in a schema or channel record, pass over any other; raises LogError if it is malformed."""
        if record.opcode == Opcode.SCHEMA:
            schema = parse(Schema, record)
            self.schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            channel = parse(Channel, record)
            self.topics[channel.id] = channel.topic, self.schemas.get(channel.schema_id, "")


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
    """

    channels: Channels = field(default_factory=Channels)
    counts: Counter[str] = field(default_factory=Counter)
    metadata: dict[str, int] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)

    def learn(self, record: Record) -> None:
        """Take in any record of a data or summary section; raises LogError if it is malformed."""
        self.channels.learn(record)
        match record.opcode:
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
    LogError
        If the file is cut off or its summary is damaged.
    """
    size = file.seek(0, SEEK_END)
    start = _summary_start(file, size)
    if start == 0:
        return None
    file.seek(start)
    contents = Contents()
    statistics = None
    for record in read_summary(file, size):
        contents.learn(record)
        if record.opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, record)
    if statistics is None or not _all_indexed(contents, statistics):
        return None
    for channel, (topic, _) in contents.channels.topics.items():
        contents.counts[topic] += statistics.channel_message_counts.get(channel, 0)
    return contents


def _all_indexed(contents: Contents, statistics: Statistics) -> bool:
    return (
        len(contents.channels.topics) == statistics.channel_count
        and bool(contents.metadata) == bool(statistics.metadata_count)
        and bool(contents.attachments) == bool(statistics.attachment_count)
    )


def read_metadata(file: BinaryIO, offset: int) -> dict[str, str]:
    """Return the metadata at `offset`; raises LogError if there is none."""
    metadata: dict[str, str] = parse(Metadata, _record_at(file, offset, Opcode.METADATA)).metadata
    return metadata


def read_attachment(file: BinaryIO, offset: int) -> bytes:
    """Return the attachment at `offset`; raises LogError if there is none or its CRC does not hold."""
    record = _record_at(file, offset, Opcode.ATTACHMENT)
    data: bytes = parse(Attachment, record).data
    if struct.unpack("<I", record.body[-4:])[0] not in (0, zlib.crc32(record.body[:-4])):
        raise damaged(offset, "the CRC of an attachment does not hold")
    return data


def _record_at(file: BinaryIO, offset: int, opcode: Opcode) -> Record:
    size = file.seek(0, SEEK_END)
    if offset >= size:
        raise cut_off(size)
    file.seek(offset)
    record = read_record(file, size)
    if record.opcode != opcode:
        raise damaged(offset, f"expected a record of kind {int(opcode)}, found {record.opcode}")
    return record


def _summary_start(file: BinaryIO, size: int) -> int:
    end = size - FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        raise cut_off(size)
    file.seek(end)
    try:
        footer = read_record(file, size)
    except LogError:
        raise cut_off(size) from None
    if footer.opcode != Opcode.FOOTER or file.read() != MAGIC:
        raise cut_off(size)
    start: int = parse(Footer, footer).summary_start
    if start > end:
        raise damaged(end, "its footer points past its end")
    return start
