"""Contents of a log from its summary section: topics, counts, chunks, offsets of metadata and attachments."""

from collections import Counter
from dataclasses import dataclass, field
from io import SEEK_END
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from recorders.mcap_format.attachments import attachment_data, attachment_head, check_attachment
from recorders.mcap_format.channels import ChannelRegistry
from recorders.mcap_format.chunk_index import ChunkTable
from recorders.mcap_format.errors import TooLarge
from recorders.mcap_format.lengths import MAX_CHUNK
from recorders.mcap_format.records import RawRecord, parse, summary_records
from recorders.mcap_format.sections import check_data_section, read_footer, record_at


@dataclass
class ChannelTable:
    """The channels met so far, and their schemas.

    Attributes
    ----------
    schemas : dict
        Name of a schema by its number.
    topics : dict
        Topic and type of a channel by its number.
    declarations : ChannelRegistry
        The same channels with nothing left out.
    wanted : frozenset, optional
        Topics that are asked for; all if None.
    chosen : dict
        The same as `topics`, but None for a channel that is not asked for.
    complete : bool
        Whether each channel's schema was there before it.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, str]] = field(default_factory=dict)
    declarations: ChannelRegistry = field(default_factory=ChannelRegistry)
    wanted: frozenset[str] | None = None
    chosen: dict[int, tuple[str, str] | None] = field(default_factory=dict)
    complete: bool = True

    def register(self, record: RawRecord) -> None:
        """Take in a schema or channel record, pass over any other; raises DamagedLog if it is malformed."""
        match self.declarations.register(record):
            case Schema() as schema:
                self.schemas[schema.id] = schema.name
            case Channel() as channel:
                self.complete &= not channel.schema_id or channel.schema_id in self.schemas
                self._declare(channel.id, (channel.topic, self.schemas.get(channel.schema_id, "")))

    def register_all(self, other: "ChannelTable") -> None:
        """Take in the channels that another part of the log declares."""
        self.declarations.add(other.declarations)
        self.schemas.update(other.schemas)
        for channel, declared in other.topics.items():
            self._declare(channel, declared)

    def _declare(self, channel: int, declared: tuple[str, str]) -> None:
        known = self.topics.get(channel)
        if known and not declared[1] and known[0] == declared[0]:
            declared = known  # its schema was not met before it, but the summary knows it
        self.topics[channel] = declared
        self.chosen[channel] = declared if self.wanted is None or declared[0] in self.wanted else None


class NamedOffset(NamedTuple):
    """The offset of a named record in a file [bytes], and its name."""

    offset: int
    name: str


@dataclass
class Contents:
    """The contents of a log.

    Attributes
    ----------
    channels : ChannelTable
        Every channel of the log.
    counts : Counter
        Number of messages by topic.
    metadata, attachments : list of NamedOffset
        Where each stands, by its name; several may have one.
    chunks : ChunkTable
        Where the chunks stand.
    statistics : Statistics, optional
        Numbers of everything, if the writer made any.
    summary_start : int
        Where the summary section begins that this is from [bytes]; the data section ends there. 0 without one.
    has_crc : bool
        Whether that section has a CRC; it was checked.
    crc_verified : bool
        Whether this is from a summary section that a CRC covers and that knows every channel and chunk.
    """

    channels: ChannelTable = field(default_factory=ChannelTable)
    counts: Counter[str] = field(default_factory=Counter)
    metadata: list[NamedOffset] = field(default_factory=list)
    attachments: list[NamedOffset] = field(default_factory=list)
    chunks: ChunkTable = field(default_factory=ChunkTable)
    statistics: Statistics | None = None
    summary_start: int = 0
    has_crc: bool = False
    crc_verified: bool = False

    def register(self, record: RawRecord) -> None:
        """Take in any record of a data or summary section; raises DamagedLog if it is malformed."""
        self.channels.register(record)
        match record.opcode:
            case Opcode.CHUNK_INDEX:
                self.chunks.register(record)
            case Opcode.STATISTICS:
                self.statistics = parse(Statistics, record)
            case Opcode.METADATA_INDEX:
                metadata_index = parse(MetadataIndex, record)
                self.metadata.append(NamedOffset(metadata_index.offset, metadata_index.name))
            case Opcode.ATTACHMENT_INDEX:
                attachment_index = parse(AttachmentIndex, record)
                self.attachments.append(NamedOffset(attachment_index.offset, attachment_index.name))
            case Opcode.METADATA:
                self.metadata.append(NamedOffset(record.offset, parse(Metadata, record).name))
            case Opcode.ATTACHMENT:
                self.attachments.append(NamedOffset(record.offset, attachment_head(record).name))


def read_summary(file: BinaryIO) -> Contents | None:
    """Return what the summary section states, without its sums over topics; None for a file without one.

    Raises
    ------
    DamagedLog
        If the file is cut off or its summary is damaged.
    """
    footer = read_footer(file)
    size = file.seek(0, SEEK_END)
    if footer.summary_start == 0:
        return None
    contents = Contents(summary_start=footer.summary_start, has_crc=bool(footer.summary_crc))
    file.seek(footer.summary_start)
    for record in summary_records(file, size):
        contents.register(record)
    contents.metadata.sort()
    contents.attachments.sort()
    return contents


def read_contents(file: BinaryIO) -> Contents | None:
    """Return the contents of the summary section, None for a file that was written without one, or with half of one.

    Raises
    ------
    DamagedLog
        If the file is cut off or its summary is damaged.
    """
    contents = read_summary(file)
    if contents is None or (statistics := contents.statistics) is None or not _all_indexed(contents, statistics):
        return None
    for channel, (topic, _) in contents.channels.topics.items():
        contents.counts[topic] += statistics.channel_message_counts.get(channel, 0)
    whole = contents.chunks.ordered and len(contents.chunks) == statistics.chunk_count
    contents.crc_verified = whole and contents.has_crc
    return contents


def _all_indexed(contents: Contents, statistics: Statistics) -> bool:
    """Whether a summary states all that is needed: writers may leave out any part of it."""
    return (
        contents.channels.complete
        and len(contents.channels.topics) == statistics.channel_count
        and len(contents.metadata) == statistics.metadata_count
        and len(contents.attachments) == statistics.attachment_count
        and sum(statistics.channel_message_counts.values()) == statistics.message_count
    )


def read_metadata(file: BinaryIO, offset: int) -> dict[str, str]:
    """Return the metadata at `offset`; raises DamagedLog if there is none."""
    metadata: dict[str, str] = parse(Metadata, record_at(file, offset, Opcode.METADATA)).metadata
    return metadata


def read_attachment(file: BinaryIO, offset: int) -> bytes:
    """Return the data of the attachment at `offset`.

    Raises
    ------
    TooLarge
        If it is larger than one that is read into memory.
    DamagedLog
        If there is none or its CRC does not hold.
    """
    record = record_at(file, offset, Opcode.ATTACHMENT)
    size = attachment_head(record).size
    if size > MAX_CHUNK:
        raise TooLarge(offset, f"an attachment of {size} bytes, and {MAX_CHUNK} is the most that is read at once")
    if not check_attachment(record):
        check_data_section(file)
    return b"".join(attachment_data(record))
