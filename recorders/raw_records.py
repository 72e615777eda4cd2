"""The inner loop of the reader: messages, undecoded, out of the decompressed chunks and the bare records of a log."""

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

from mcap.opcode import Opcode

from recorders.chunk_contents import MESSAGE, body_at
from recorders.damage import DamagedLog, damaged
from recorders.mcap_contents import Channels
from recorders.mcap_records import Record
from recorders.records import Stamped

FOREVER_NS = 2**64
"""Later than every log time [ns]."""

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_BATCH = 2**15  # bytes of a run: they fit the processor's cache, and one step of a generator serves many messages
_MESSAGE_OPCODE = int(Opcode.MESSAGE)  # a plain number is compared faster than a member of an enumeration
_new_tuple = tuple.__new__  # a named tuple's own constructor takes twice as long


@dataclass
class MessageWalk:
    """Walks through records, and makes a `Stamped` of each message that is asked for.

    Attributes
    ----------
    channels : Channels
        What is known of channels, and which topics are wanted.
    start_ns, end_ns : int
        Messages of log time [start_ns, end_ns) are asked for.
    last_time_ns : int or None
        Log time of the last message met, asked for or not [ns].
    """

    channels: Channels = field(default_factory=Channels)
    start_ns: int = 0
    end_ns: int = FOREVER_NS
    last_time_ns: int | None = None

    def chunk(self, data: bytes, offset: int) -> Iterator[list[Stamped]]:
        """Yield the messages in the data of the chunk at `offset`, a batch at a time.

        Raises
        ------
        DamagedLog
            If a record in it is not whole, or of an undeclared channel, after yielding every message before that.
        """
        place = 0
        while place < len(data):
            batch, then = self._run(data, place)
            if batch:
                yield self._of_time(batch)
            place = then if then > place else self._other(data, place, offset)

    def bare(self, record: Record) -> list[Stamped]:
        """Return the message that a record outside of chunks is, as a list that is empty if it is not asked for."""
        if len(record.body) < MESSAGE.size:
            raise damaged(record.offset, "a message is too short")
        channel, sequence, log_time_ns, _ = MESSAGE.unpack_from(record.body)
        if channel not in self.channels.chosen:
            raise _undeclared(record.offset, channel)
        self.last_time_ns = log_time_ns
        declared = self.channels.chosen[channel]
        if declared is None or not self.start_ns <= log_time_ns < self.end_ns:
            return []
        return [Stamped(*declared, record.part(MESSAGE.size, record.size - MESSAGE.size), sequence, log_time_ns)]

    @property
    def sliced(self) -> bool:
        """Whether messages of some time only are asked for."""
        return self.start_ns > 0 or self.end_ns < FOREVER_NS

    def _of_time(self, batch: list[Stamped]) -> list[Stamped]:
        if not self.sliced:
            return batch
        return [record for record in batch if self.start_ns <= record.log_time_ns < self.end_ns]

    def _run(self, data: bytes, place: int) -> tuple[list[Stamped], int]:
        """Return the messages from `place` on, and where something else stands or a batch is full."""
        chosen, unpack, size = self.channels.chosen, _MESSAGE.unpack_from, len(data)
        last = min(place + _BATCH, size - _MESSAGE.size)
        batch: list[Stamped] = []
        time_ns = self.last_time_ns
        with suppress(KeyError):  # an undeclared channel ends the run, as does whatever is no whole message
            while place <= last:
                opcode, length, channel, sequence, log_time_ns, _publish_time_ns = unpack(data, place)
                end = place + 9 + length
                if opcode != _MESSAGE_OPCODE or length < 22 or end > size:
                    break
                declared = chosen[channel]
                if declared is not None:
                    topic, kind = declared
                    batch.append(_new_tuple(Stamped, (topic, kind, data[place + 31 : end], sequence, log_time_ns)))
                time_ns = log_time_ns
                place = end
        self.last_time_ns = time_ns
        return batch, place

    def _other(self, data: bytes, place: int, offset: int) -> int:
        """Take in the record at `place`, which is no sound message, and return where the next one stands."""
        opcode, start, end = body_at(data, place, offset)
        if opcode == _MESSAGE_OPCODE:  # a sound one is none of ours to take
            raise _undeclared(offset, MESSAGE.unpack_from(data, start)[0])
        self.channels.learn(Record(opcode, offset, data[start:end]))
        return end


def _undeclared(offset: int, channel: int) -> DamagedLog:
    return damaged(offset, f"a message is on channel {channel}, which was not declared")
