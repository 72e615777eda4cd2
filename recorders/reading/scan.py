"""One pass through a log: each record is checked, and the messages come out in the order of the file.

What carries a CRC of its own is believed when that holds. What does not (a message, a schema or a channel beside the
chunks, a chunk without CRC, a record of unknown kind) is believed when the CRC over the whole data section holds; so
the first such thing costs one more pass. A log without that CRC, or cut off before it, is read as it is.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from typing import BinaryIO, Protocol

from mcap.opcode import Opcode

from recorders.mcap_format.attachments import check_attachment
from recorders.mcap_format.chunk_index import ChunkTable
from recorders.mcap_format.errors import damaged
from recorders.mcap_format.lengths import Expansion
from recorders.mcap_format.message_index import states_order
from recorders.mcap_format.records import RawRecord, chunk_data, chunk_head, read_all
from recorders.mcap_format.sections import check_data_section
from recorders.mcap_format.summary import ChannelTable
from recorders.messages.record import RecordedMessage

_CHUNK = int(Opcode.CHUNK)  # a plain number is compared faster than a member of an enumeration
_CHECKED = frozenset({Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END})


class ScanVisitor(Protocol):
    """Takes the messages of a scan; each channel must be registered before its messages."""

    channels: ChannelTable

    def chunk(self, data: bytes, offset: int, states_order: Callable[[int], bool]) -> Iterator[list[RecordedMessage]]:
        """Take in the data of the chunk at `offset` [bytes], and the order that its indexes state: see `message_index`.

        Raises
        ------
        DamagedLog
            If a record in them is damaged.
        """

    def bare(self, record: RawRecord) -> list[RecordedMessage]:
        """Take in a message beside the chunks; raises DamagedLog if it is damaged."""


class LogScan:
    """A pass through a file.

    Parameters
    ----------
    file : file
        A log, open at its first byte.
    walk : ScanVisitor
        Makes the messages, and knows which are asked for.
    chunks : ChunkTable
        The chunks that must be met; empty without a verified summary.
    skip_ranges : mapping of int to int
        Where to go on, by the offsets of the chunks to leave out.
    """

    def __init__(self, file: BinaryIO, walk: ScanVisitor, chunks: ChunkTable, skip_ranges: Mapping[int, int]) -> None:
        self._file = file
        self._walk = walk
        self._chunks = chunks
        self._skip_ranges = skip_ranges
        self._next_chunk = 0
        self._verified = False

    def batches(self, on_record: Callable[[RawRecord], None]) -> Iterator[list[RecordedMessage]]:
        """Yield the messages, some at a time, and hand other records, but for chunks and indexes, to `on_record`.

        Raises
        ------
        DamagedLog
            If the log is cut off or damaged, after yielding every message before that.
        """
        size = os.fstat(self._file.fileno()).st_size
        expansion = Expansion(size)
        for record in read_all(self._file, size, skip_ranges=self._skip_ranges):
            self._check_place(record)
            if record.opcode == _CHUNK:
                head = chunk_head(record)
                expansion.take(record.offset, head.size)
                if not head.crc:
                    self._verify()
                data, offset = chunk_data(record, head), record.offset
                del record  # what it holds is in `data`, and there is no room for both and a message
                yield from self._walk.chunk(data, offset, self._states_order)
                del data
            elif record.opcode == Opcode.MESSAGE:
                self._verify()
                yield self._walk.bare(record)
            else:
                self._register(record, on_record)

    def _states_order(self, most: int) -> bool:
        return states_order(self._file, most)

    def _register(self, record: RawRecord, on_record: Callable[[RawRecord], None]) -> None:
        if record.opcode not in _CHECKED:
            self._verify()
        elif record.opcode == Opcode.ATTACHMENT:
            check_attachment(record)
        self._walk.channels.register(record)
        on_record(record)

    def _verify(self) -> None:
        if not self._verified:
            check_data_section(self._file)
            self._verified = True

    def _check_place(self, record: RawRecord) -> None:
        """Check that the chunks are at the offsets that the summary states."""
        offsets, number = self._chunks.offsets, self._next_chunk
        while number < len(offsets) and offsets[number] < record.offset and self._skip_ranges:
            number += 1  # left out
        if number < len(offsets) and offsets[number] <= record.offset:
            if offsets[number] != record.offset or record.opcode != _CHUNK:
                raise damaged(offsets[number], "a chunk is missing that its summary knows")
            number += 1
        self._next_chunk = number
