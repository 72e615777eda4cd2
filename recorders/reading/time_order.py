"""Messages in order of log time out of a log whose chunks overlap in time: those that do are merged.

One look at the whole log notes of which times the messages of each piece really are, whatever the heads state. A
piece is a chunk, or up to 1 MiB of messages in a row that stand beside the chunks. A piece is in memory from its first
message to its last, so that memory grows with what overlaps, and not with the log.
"""

import heapq
from array import array
from collections.abc import Callable, Iterator
from typing import BinaryIO, TypeAlias

import numpy as np

from recorders.errors import LogError
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.records import RawRecord, chunk_data, read_record
from recorders.mcap_format.summary import ChannelTable
from recorders.messages.record import RecordedMessage
from recorders.reading.raw_messages import MessageScanner, in_order

MOST_HELD = 160_000_000
"""Limit of what is held at once of pieces that overlap [bytes, decompressed]: reading a log takes 256 MB with it."""

_PLACE = 4  # bytes that it takes to remember where a message stands
_BLOCK = 2**20  # bytes of messages beside the chunks that are taken as one piece

# log time [ns] and piece of the next message
_UnderWay: TypeAlias = tuple[int, int, RecordedMessage, Iterator[RecordedMessage]]


class Pieces:
    """A walk that makes no messages: it notes where they stand, and of which times they are.

    Attributes
    ----------
    channels : ChannelTable
        The channels of the log.
    last_time_ns : int or None
        Log time of the last message met [ns].
    damage : DamagedLog or None
        What ended the walk too early.
    offsets, ends, sizes : array of int
        Where a piece begins, where it ends (0 for a chunk), how much it is in memory [bytes]: nothing for one large
        message, which is read when it is due and then gone.
    first_ns, last_ns : array of int
        The earliest and the latest time in it [ns].
    """

    def __init__(self) -> None:
        self.channels = ChannelTable()
        self.last_time_ns: int | None = None
        self.damage: DamagedLog | None = None
        self.offsets, self.ends, self.sizes = array("Q"), array("Q"), array("Q")
        self.first_ns, self.last_ns = array("Q"), array("Q")
        self._block_end = 0  # where the block of messages ends that may go on
        self._size = 0
        self._check_at = MOST_HELD

    def chunk(self, data: bytes, offset: int, states_order: Callable[[int], bool]) -> Iterator[list[RecordedMessage]]:
        """Note a chunk; yields nothing, and raises DamagedLog if a record in it is damaged."""
        times_ns, _, error = MessageScanner(self.channels).placed(data, offset)
        if times_ns:
            times = np.asarray(times_ns)
            size = len(data) + len(times) * _PLACE
            self._add(offset, 0, size, int(times.min()), int(times.max()))
            self.last_time_ns = times_ns[-1]
        if error is not None:
            raise error
        return iter(())

    def bare(self, record: RawRecord) -> list[RecordedMessage]:
        """Note a message beside the chunks; returns nothing, and raises DamagedLog if it is damaged."""
        walk = MessageScanner(self.channels, end_ns=0)  # makes no message: it may be large
        walk.bare(record)
        time_ns, end = walk.last_time_ns or 0, record.end
        if self._block_end == record.offset and end - self.offsets[-1] <= _BLOCK:
            self.ends[-1] = end
            self.sizes[-1] = end - self.offsets[-1]
            self.first_ns[-1] = min(self.first_ns[-1], time_ns)
            self.last_ns[-1] = max(self.last_ns[-1], time_ns)
        else:
            size = end - record.offset
            self._add(record.offset, end, size if size <= _BLOCK else 0, time_ns, time_ns)
        self._block_end = end
        self.last_time_ns = time_ns
        return []

    def _add(self, offset: int, end: int, size: int, first_ns: int, last_ns: int) -> None:
        columns = self.offsets, self.ends, self.sizes, self.first_ns, self.last_ns
        if len(self.offsets) * len(columns) * self.offsets.itemsize > MOST_HELD:
            raise LogError(f"expected at most {len(self.offsets)} chunks out of order of log time, found more")
        for column, value in zip(columns, (offset, end, size, first_ns, last_ns), strict=True):
            column.append(value)
        self._size += size
        if self._size > self._check_at:  # a log that cannot be merged is no longer read to its end
            self._check_at = 2 * self._size
            self._check_held(self._by_time())

    def _by_time(self) -> list[int]:
        order: list[int] = np.argsort(np.asarray(self.first_ns), kind="stable").tolist()
        return order

    def between(self, start_ns: int, end_ns: int) -> Iterator[int]:
        """Yield the pieces that hold times in [start_ns, end_ns), by their first time; those of one in file order.

        Raises
        ------
        LogError
            If more of them than may be held at once overlap in time.
        """
        chosen = [row for row in self._by_time() if self.first_ns[row] < end_ns and self.last_ns[row] >= start_ns]
        self._check_held(chosen)
        return iter(chosen)

    def _check_held(self, chosen: list[int]) -> None:
        held, under_way = 0, list[tuple[int, int]]()  # last time [ns], piece
        for row in chosen:
            while under_way and under_way[0] < (self.first_ns[row], row):
                held -= self.sizes[heapq.heappop(under_way)[1]]
            heapq.heappush(under_way, (self.last_ns[row], row))
            held += self.sizes[row]
            if held > MOST_HELD and len(under_way) > 1:
                raise LogError(
                    f"expected at most {MOST_HELD // 10**6} MB of chunks that overlap in log time, to be merged "
                    "within 256 MB of memory in all, found more; sort the log first, as with `mcap sort`, or go by the "
                    "order of the file with --as-recorded or --as-live"
                )


def merged(file: BinaryIO, size: int, pieces: Pieces, walk: MessageScanner) -> Iterator[RecordedMessage]:
    """Yield messages in order of log time, those of one time in file order.

    Parameters
    ----------
    file : file
        A log.
    size : int
        Its size [bytes].
    pieces : Pieces
        A walk through the whole of it.
    walk : MessageScanner
        Makes the messages, and knows which are asked for.

    Raises
    ------
    DamagedLog
        If the log is cut off or damaged, after yielding every message before that.
    LogError
        If more of it overlaps in time than may be held, before yielding any.
    """
    walk.channels.register_all(pieces.channels)
    under_way: list[_UnderWay] = []  # a heap; no two of one piece
    for row in pieces.between(walk.start_ns, walk.end_ns):
        while under_way and under_way[0][:2] < (pieces.first_ns[row], row):
            yield _pop(under_way, walk)
        _advance(under_way, row, _messages(file, size, pieces.offsets[row], pieces.ends[row], walk))
    while under_way:
        yield _pop(under_way, walk)
    if pieces.damage is not None:
        raise pieces.damage


def _pop(under_way: list[_UnderWay], walk: MessageScanner) -> RecordedMessage:
    walk.last_time_ns, row, record, stream = heapq.heappop(under_way)
    _advance(under_way, row, stream)
    return record


def _advance(under_way: list[_UnderWay], row: int, stream: Iterator[RecordedMessage]) -> None:
    record = next(stream, None)
    if record is not None:
        heapq.heappush(under_way, (record.log_time_ns, row, record, stream))


def _messages(file: BinaryIO, size: int, offset: int, end: int, walk: MessageScanner) -> Iterator[RecordedMessage]:
    """Yield the messages of a piece by their times; what is wrong behind them was found before."""
    file.seek(offset)
    if end - offset > _BLOCK:  # one large message
        yield from walk.bare(read_record(file, size))
        return
    data = file.read(end - offset) if end else chunk_data(read_record(file, size))
    times_ns, positions, _ = walk.placed(data, offset)
    for position in in_order(times_ns, positions):
        yield walk.message(data, position)
