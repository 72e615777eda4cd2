"""The summary section of a log where its own CRC holds: what there should be in the file, and where."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import BinaryIO

from mcap.records import Statistics

from recorders.errors import LogError
from recorders.mcap_format.channels import ChannelRegistry, DeclaredChannel
from recorders.mcap_format.sections import find_data_end
from recorders.mcap_format.summary import read_summary


@dataclass(frozen=True)
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
    indexed : bool
        Whether every chunk has its place in `offsets`.
    """

    start: int
    declarations: ChannelRegistry
    statistics: Statistics | None
    offsets: list[int]
    attachments: list[str]
    indexed: bool

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


def read_verified_summary(file: BinaryIO) -> VerifiedSummary | None:
    """Return the summary section of a log, None if there is none or no CRC shows that it is sound."""
    try:
        found = read_summary(file)
    except LogError:
        return None
    if found is None or not found.has_crc:
        return None
    beside = [entry.offset for entry in (*found.metadata, *found.attachments)]
    within = {offset for offset in (*found.chunks.offsets, *beside) if offset < found.summary_start}
    data_end = find_data_end(file, found.summary_start)
    return VerifiedSummary(
        found.summary_start,
        found.channels.declarations,
        found.statistics,
        offsets=sorted(within if data_end is None else {*within, data_end}),
        attachments=[entry.name for entry in found.attachments],
        indexed=found.statistics is not None and len(found.chunks) == found.statistics.chunk_count,
    )
