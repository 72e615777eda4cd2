"""The summary section of a log where its own CRC holds: what there should be in the file, and where."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import SEEK_END
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, MetadataIndex, Statistics

from recorders.errors import LogError
from recorders.mcap_format.channels import ChannelRegistry, DeclaredChannel
from recorders.mcap_format.records import RawRecord, check_summary, parse, summary_records
from recorders.mcap_format.sections import find_data_end, read_footer


@dataclass
class VerifiedSummary:
    """The contents of a summary section that a CRC covers.

    Attributes
    ----------
    start : int
        Where it begins [bytes]; the data section ends there.
    declarations : ChannelRegistry
        The channels.
    statistics : Statistics, optional
        Numbers of everything, if the writer made any.
    offsets : list of int
        Where chunks, metadata, attachments and the end of the data section begin, in order [bytes].
    attachments : list of str
        Names of the attachments.
    chunks : int
        How many chunks are among `offsets`.
    """

    start: int
    declarations: ChannelRegistry = field(default_factory=ChannelRegistry)
    statistics: Statistics | None = None
    offsets: list[int] = field(default_factory=list)
    attachments: list[str] = field(default_factory=list)
    chunks: int = 0

    def counts(self, channels: Mapping[int, DeclaredChannel]) -> Counter[str] | None:
        """Return the number of messages by topic, None if the summary does not state it: an empty map states nothing.

        Parameters
        ----------
        channels : mapping of int to DeclaredChannel
            What the log declares: the summary need not repeat it.
        """
        stated = self.statistics
        if stated is None or (stated.message_count and not stated.channel_message_counts):
            return None
        counts: Counter[str] = Counter()
        for channel, count in stated.channel_message_counts.items():
            declared = channels.get(channel) or self.declarations.channels.get(channel)
            counts[declared.topic if declared else f"channel {channel}"] += count
        return counts

    @property
    def indexed(self) -> bool:
        """Whether every chunk has its place in `offsets`."""
        return self.statistics is not None and self.chunks == self.statistics.chunk_count

    def register(self, record: RawRecord) -> None:
        """Take in a record of the section; raises LogError if it is malformed."""
        self.declarations.register(record)
        match record.opcode:
            case Opcode.STATISTICS:
                self.statistics = parse(Statistics, record)
            case Opcode.CHUNK_INDEX:
                self.chunks += 1
                self.offsets.append(parse(ChunkIndex, record).chunk_start_offset)
            case Opcode.METADATA_INDEX:
                self.offsets.append(parse(MetadataIndex, record).offset)
            case Opcode.ATTACHMENT_INDEX:
                index = parse(AttachmentIndex, record)
                self.offsets.append(index.offset)
                self.attachments.append(index.name)


def read_verified_summary(file: BinaryIO) -> VerifiedSummary | None:
    """Return the summary section of a log, None if there is none or no CRC shows that it is sound."""
    size = file.seek(0, SEEK_END)
    try:
        footer = read_footer(file)
        if not (footer.summary_crc and footer.summary_start):
            return None
        summary = VerifiedSummary(footer.summary_start)
        file.seek(footer.summary_start)
        check_summary(file, size)
        file.seek(footer.summary_start)
        for record in summary_records(file, size):
            summary.register(record)
    except LogError:
        return None
    within = {offset for offset in summary.offsets if offset < summary.start}
    data_end = find_data_end(file, summary.start)
    summary.offsets = sorted(within if data_end is None else {*within, data_end})
    return summary
