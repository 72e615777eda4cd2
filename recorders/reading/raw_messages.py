"""The inner loop of the reader: messages, undecoded, out of the decompressed chunks and the bare records of a log."""

import struct
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from operator import itemgetter

import numpy as np
from mcap.opcode import Opcode

from recorders.errors import LogError
from recorders.mcap_format.chunk_contents import MESSAGE, body_at, check_others
from recorders.mcap_format.errors import DamagedLog, damaged
from recorders.mcap_format.records import RawRecord
from recorders.mcap_format.summary import ChannelTable
from recorders.messages.record import RecordedMessage, published

WRONG_TIMES = (
    "expected log times as the chunks and their indexes state them, found others: the order of the messages cannot be "
    "determined; `reenact recover` writes the log with the right ones"
)

FOREVER_NS = 2**64
"""Later than every log time [ns]."""

_MESSAGE = struct.Struct("<BQHIQ8x")  # opcode, length, channel, sequence, log time; the publish time is not asked for
_TIMES = struct.Struct("<9xH4xQQ")  # channel, log time, publish time
_TIME = struct.Struct("<BQ6xQ")  # opcode, length, log time
_BATCH = 2**15  # bytes of a run: they fit the processor's cache, and one step of a generator serves many messages
_MESSAGE_OPCODE = int(Opcode.MESSAGE)  # a plain number is compared faster than a member of an enumeration
_SMALL = 2**17  # bytes: the messages of a chunk that is no larger fit the cache too, and are held until all are seen
_log_time_ns = itemgetter(RecordedMessage._fields.index("log_time_ns"))
_new_tuple = tuple.__new__  # a named tuple's own constructor takes twice as long


@dataclass
class MessageScanner:
    """Walks through records, and makes a `RecordedMessage` of each message that is asked for.

    Attributes
    ----------
    channels : ChannelTable
        What is known of channels, and which topics are wanted.
    start_ns, end_ns : int
        Messages of log time [start_ns, end_ns) are asked for.
    last_time_ns : int or None
        Log time of the last message met, asked for or not [ns].
    ordered : bool
        Whether the messages of a chunk are to come in order of log time, those of one time in the order of the chunk.
    publish_times : bool
        Whether messages whose publish times are not their log times come as `PublishedMessage`.
    """

    channels: ChannelTable = field(default_factory=ChannelTable)
    start_ns: int = 0
    end_ns: int = FOREVER_NS
    last_time_ns: int | None = None
    ordered: bool = False
    publish_times: bool = False
    _fell: bool = False  # whether the time of a message was before that of the one before

    def chunk(self, data: bytes, offset: int, states_order: Callable[[int], bool]) -> Iterator[list[RecordedMessage]]:
        """Yield the messages in the data of the chunk at `offset`, a batch at a time.

        Parameters
        ----------
        data : bytes
            The data, decompressed.
        offset : int
            Where the chunk stands [bytes].
        states_order : callable
            Whether its message indexes state that its messages, so many at most, are in order of log time.

        Raises
        ------
        DamagedLog
            If a record in it is not whole, or of an undeclared channel, after yielding every message before that.
        LogError
            If the messages are to be in order and the indexes state wrongly that they are.
        """
        if not self.ordered:
            return self._batches(data, offset)
        if len(data) <= _SMALL:
            return self._held(data, offset)
        if states_order(len(data) // _MESSAGE.size):
            return self._in_stated_order(data, offset)
        return self._batches(data, offset) if _is_in_order(data) else self._by_time(data, offset)

    def placed(self, data: bytes, offset: int) -> tuple["array[int]", "array[int]", DamagedLog | None]:
        """Return log time [ns] and position of each message that is asked for in the data of the chunk at `offset`.

        The third is what is wrong in them behind the messages, None if nothing is.
        """
        times_ns, positions = array("Q"), array("I")  # a chunk is smaller than 4 GB
        position = others = 0
        try:
            while position < len(data):
                opcode, start, end = body_at(data, position, offset)
                if opcode == _MESSAGE_OPCODE:
                    channel, _, log_time_ns, _ = MESSAGE.unpack_from(data, start)
                    if channel not in self.channels.chosen:
                        raise _undeclared(offset, channel)
                    if self.channels.chosen[channel] is not None and self.start_ns <= log_time_ns < self.end_ns:
                        times_ns.append(log_time_ns)
                        positions.append(position)
                else:
                    others += 1
                    check_others(others, offset)
                    self.channels.register(RawRecord(opcode, offset, data[start:end]))
                position = end
        except DamagedLog as error:
            return times_ns, positions, error
        return times_ns, positions, None

    def message(self, data: bytes, position: int) -> RecordedMessage:
        """Return the message at a position where a sound one of a known channel stands, which is asked for."""
        _, length, channel, sequence, log_time_ns = _MESSAGE.unpack_from(data, position)
        topic, type_name = self.channels.topics[channel]
        record = RecordedMessage(
            topic, type_name, data[position + _MESSAGE.size : position + 9 + length], sequence, log_time_ns
        )
        return published(record, _TIMES.unpack_from(data, position)[2]) if self.publish_times else record

    def bare(self, record: RawRecord) -> list[RecordedMessage]:
        """Return the message that a record outside of chunks is, as a list that is empty if it is not asked for."""
        if len(record.body) < MESSAGE.size:
            raise damaged(record.offset, "a message is too short")
        channel, sequence, log_time_ns, publish_time_ns = MESSAGE.unpack_from(record.body)
        if channel not in self.channels.chosen:
            raise _undeclared(record.offset, channel)
        self.last_time_ns = log_time_ns
        declared = self.channels.chosen[channel]
        if declared is None or not self.start_ns <= log_time_ns < self.end_ns:
            return []
        data = record.part(MESSAGE.size, record.size - MESSAGE.size)
        found = RecordedMessage(*declared, data, sequence, log_time_ns)
        return [published(found, publish_time_ns) if self.publish_times else found]

    @property
    def sliced(self) -> bool:
        """Whether messages of some time only are asked for."""
        return self.start_ns > 0 or self.end_ns < FOREVER_NS

    def _batches(self, data: bytes, offset: int) -> Iterator[list[RecordedMessage]]:
        position = others = 0
        while position < len(data):
            batch, then = self._run(data, position)
            if self.publish_times:
                batch = self._published(batch, data, position)
            if batch:
                yield self._of_time(batch)
            if then == position:
                others += 1
                check_others(others, offset)
                then = self._other(data, position, offset)
            position = then

    def _held(self, data: bytes, offset: int) -> Iterator[list[RecordedMessage]]:
        """Yield the messages of a chunk by their times: so few are all held, and sorted if they turn out to fall."""
        self._fell = False
        batches: list[list[RecordedMessage]] = []
        try:
            batches.extend(self._batches(data, offset))
        finally:  # what stands before damage counts
            if self._fell:
                batches = [sorted(chain.from_iterable(batches), key=_log_time_ns)]
            yield from batches

    def _in_stated_order(self, data: bytes, offset: int) -> Iterator[list[RecordedMessage]]:
        self._fell = False
        for batch in self._batches(data, offset):
            if self._fell:
                raise LogError(WRONG_TIMES)
            yield batch

    def _by_time(self, data: bytes, offset: int) -> Iterator[list[RecordedMessage]]:
        times_ns, positions, error = self.placed(data, offset)
        for position in in_order(times_ns, positions):
            yield [self.message(data, position)]
        if error is not None:
            raise error

    def _of_time(self, batch: list[RecordedMessage]) -> list[RecordedMessage]:
        if not self.sliced:
            return batch
        return [record for record in batch if self.start_ns <= record.log_time_ns < self.end_ns]

    def _run(self, data: bytes, position: int) -> tuple[list[RecordedMessage], int]:
        """Return the messages from `position` on, and where something else stands or a batch is full."""
        chosen, unpack, size = self.channels.chosen, _MESSAGE.unpack_from, len(data)
        begin, last = position, min(position + _BATCH, size - _MESSAGE.size)
        batch: list[RecordedMessage] = []
        time_ns, ordered, fell = self.last_time_ns or 0, self.ordered, False
        new, kind_of_all, message = _new_tuple, RecordedMessage, _MESSAGE_OPCODE  # locals are faster
        with suppress(KeyError):  # an undeclared channel ends the run, as does whatever is no whole message
            while position <= last:
                opcode, length, channel, sequence, log_time_ns = unpack(data, position)
                end = position + 9 + length
                if opcode != message or length < 22 or end > size:
                    break
                declared = chosen[channel]
                if declared is not None:
                    topic, type_name = declared
                    batch.append(new(kind_of_all, (topic, type_name, data[position + 31 : end], sequence, log_time_ns)))
                if ordered and log_time_ns < time_ns:
                    fell = True
                time_ns = log_time_ns
                position = end
        if position > begin:
            self.last_time_ns = time_ns
            self._fell |= fell
        return batch, position

    def _published(self, batch: list[RecordedMessage], data: bytes, position: int) -> list[RecordedMessage]:
        """Return the messages of a run from `position` on, with their publish times."""
        chosen, unpack, found = self.channels.chosen, _TIMES.unpack_from, list[RecordedMessage]()
        for record in batch:
            channel, log_time_ns, publish_time_ns = unpack(data, position)
            while chosen[channel] is None:
                position = _end(data, position)
                channel, log_time_ns, publish_time_ns = unpack(data, position)
            found.append(record if log_time_ns == publish_time_ns else published(record, publish_time_ns))
            position += _MESSAGE.size + len(record.data)
        return found

    def _other(self, data: bytes, position: int, offset: int) -> int:
        """Take in the record at `position`, which is no sound message, and return where the next one stands."""
        opcode, start, end = body_at(data, position, offset)
        if opcode == _MESSAGE_OPCODE:  # a sound one is none of ours to take
            raise _undeclared(offset, MESSAGE.unpack_from(data, start)[0])
        self.channels.register(RawRecord(opcode, offset, data[start:end]))
        return end


def in_order(times_ns: "array[int]", positions: "array[int]") -> "array[int]":
    """Return positions by time, those of one time in the order in which they came."""
    order = np.argsort(np.asarray(times_ns), kind="stable")
    return array(positions.typecode, np.asarray(positions)[order].tobytes())


def _end(data: bytes, position: int) -> int:
    """Return where the record at a position ends."""
    return position + 9 + int(_TIME.unpack_from(data, position)[1])


def _is_in_order(data: bytes) -> bool:
    """Whether the times of the messages in a chunk never fall, as far as it is whole."""
    position, last_ns, unpack, end = 0, 0, _TIME.unpack_from, len(data) - _TIME.size
    while position <= end:
        opcode, length, log_time_ns = unpack(data, position)
        if opcode == _MESSAGE_OPCODE:
            if log_time_ns < last_ns:
                return False
            last_ns = log_time_ns
        position += 9 + length
    return True


def _undeclared(offset: int, channel: int) -> DamagedLog:
    return damaged(offset, f"a message is on channel {channel}, which was not declared")
