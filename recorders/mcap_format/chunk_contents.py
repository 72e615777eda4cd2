"""The records inside a chunk."""

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self, TypeAlias

from mcap.opcode import Opcode

from recorders.mcap_format.errors import damaged
from recorders.mcap_format.records import FIRST_RESERVED, HEAD, RawRecord, chunk_data

MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; the data follow

MAX_OTHER_RECORDS = 2**18
"""The most records of a chunk that are no messages: twice what a log can declare; more would only take time."""

_DECLARATIONS = frozenset({int(Opcode.SCHEMA), int(Opcode.CHANNEL)})
_MESSAGE_OPCODE = int(Opcode.MESSAGE)  # a plain number is compared faster than a member of an enumeration


Pending: TypeAlias = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns] and data of a message."""


class MessageColumns(NamedTuple):
    """One or more messages, in their order, column by column: many are then gone through by loops written in C.

    Attributes
    ----------
    channels, sequences, log_times_ns, publish_times_ns : sequence of int
        Number of the channel, number of the message, time of recording and of publication [ns] of each.
    data : sequence of bytes
        The messages themselves.
    sizes : sequence of int
        How long each is [bytes].
    """

    channels: Sequence[int]
    sequences: Sequence[int]
    log_times_ns: Sequence[int]
    publish_times_ns: Sequence[int]
    data: Sequence[bytes]
    sizes: Sequence[int]

    @classmethod
    def of(cls, messages: Sequence[Pending]) -> Self:
        """Return the columns of one or more messages."""
        channels, sequences, log_times_ns, publish_times_ns, data = zip(*messages, strict=True)
        return cls(channels, sequences, log_times_ns, publish_times_ns, data, list(map(len, data)))


def body_at(data: bytes, position: int, offset: int) -> tuple[int, int, int]:
    """Return opcode, beginning and end of the body of the record at `position` in the data of the chunk at `offset`.

    Raises
    ------
    DamagedLog
        If it is not whole, a message too short to be one, or of a kind that has no place in a chunk.
    """
    start = position + HEAD.size
    if start > len(data):
        raise damaged(offset, "the last record of a chunk is cut off")
    opcode, length = HEAD.unpack_from(data, position)
    if length > len(data) - start:
        raise damaged(offset, "a record is longer than the chunk that holds it")
    if opcode == _MESSAGE_OPCODE and length < MESSAGE.size:
        raise damaged(offset, "a message is too short")
    if opcode < FIRST_RESERVED and opcode != _MESSAGE_OPCODE and opcode not in _DECLARATIONS:
        raise damaged(offset, f"a record of kind {opcode} in a chunk")
    return opcode, start, start + length


def split(data: bytes, offset: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, beginning and end of the body of each record in the data of the chunk at `offset`.

    Raises as `body_at` and `check_others` do.
    """
    position, size, others = 0, len(data), 0
    while position < size:
        opcode, start, position = body_at(data, position, offset)
        if opcode != _MESSAGE_OPCODE:
            others += 1
            check_others(others, offset)
        yield opcode, start, position


def check_others(count: int, offset: int) -> None:
    """Check how many records that are no messages the chunk at `offset` holds; raises DamagedLog if too many."""
    if count > MAX_OTHER_RECORDS:
        raise damaged(offset, f"a chunk of more than {MAX_OTHER_RECORDS} records that are no messages")


def checked(chunk: RawRecord) -> bytes:
    """Return the data of a chunk; raises DamagedLog if the chunk or a record in it is damaged, or does not belong."""
    data = chunk_data(chunk)
    for _ in split(data, chunk.offset):
        pass
    return data


def declarations(data: bytes, offset: int) -> Iterator[RawRecord]:
    """Yield the schemas and channels in the data of the chunk at `offset`; raises as `split` does."""
    for opcode, start, end in split(data, offset):
        if opcode in _DECLARATIONS:
            yield RawRecord(opcode, offset, data[start:end])
