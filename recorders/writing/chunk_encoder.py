"""Chunks of a log, encoded whole: the messages of many calls with one call each of what is written in C."""

import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import accumulate, repeat
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from recorders.mcap_format.chunk_contents import MESSAGE, MessageColumns
from recorders.mcap_format.records import CRC, HEAD

_PACK: dict[str, Callable[[bytes], bytes]] = {
    "": lambda data: data,
    "lz4": lz4.frame.compress,
    "zstd": lambda data: zstandard.ZstdCompressor().compress(data),
}

RECORD = struct.Struct(HEAD.format + MESSAGE.format.removeprefix("<"))
"""A message's record up to its data: opcode, length, channel, sequence, log and publish time."""

RECORD_SIZE = RECORD.size
"""What a message takes in a chunk beside its data, before that is compressed [bytes]."""

_CHUNK = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression's name
_ENTRY = struct.Struct("<QQ")  # log time, offset in the chunk
_INDEX = struct.Struct(HEAD.format + "HI")  # channel, length of the entries
_PLACE = struct.Struct("<HQ")  # channel, offset of its message index
_CHUNK_INDEX = struct.Struct("<QQQQI")  # first and last time, offset, length, bytes of the places
_SIZE = struct.Struct("<Q")


class BuiltChunk(NamedTuple):
    """The content of a chunk.

    Attributes
    ----------
    data : bytes
        Records of messages, and of schemas and channels.
    times_ns : pair of int
        Least and greatest log time [ns].
    indexes : dict of bytes
        By channel, time and place in `data` of each of its messages.
    """

    data: bytes
    times_ns: tuple[int, int]
    indexes: dict[int, bytes]

    @property
    def counts(self) -> dict[int, int]:
        """Messages by channel."""
        return {channel: len(entries) // _ENTRY.size for channel, entries in self.indexes.items()}


def build_chunk(messages: MessageColumns, declared: Sequence[tuple[int, bytes]] = ()) -> BuiltChunk:
    """Put the records of a chunk together.

    Parameters
    ----------
    messages : MessageColumns
        One message or more.
    declared : sequence of (int, bytes)
        Records of schemas and channels, each with how many messages stand before it.
    """
    channels, times = messages.channels, messages.log_times_ns
    parts = message_records(messages)
    offsets: Iterable[int] = accumulate([length + RECORD_SIZE for length in messages.sizes], initial=0)
    if declared:
        parts, offsets = _with_declarations(parts, list(offsets), declared)
    entries: defaultdict[int, list[bytes]] = defaultdict(list)
    for channel, entry in zip(channels, map(_ENTRY.pack, times, offsets), strict=True):
        entries[channel].append(entry)
    indexes = {channel: b"".join(of_channel) for channel, of_channel in entries.items()}
    return BuiltChunk(b"".join(parts), (min(times), max(times)), indexes)


def message_records(messages: MessageColumns) -> list[bytes]:
    """Return the records of messages: head and data of each, in turn."""
    channels, sequences, times, publish_times, data, sizes = messages
    bodies = [size + MESSAGE.size for size in sizes]
    parts = [b""] * (2 * len(data))
    parts[::2] = map(RECORD.pack, repeat(int(Opcode.MESSAGE)), bodies, channels, sequences, times, publish_times)
    parts[1::2] = data
    return parts


def encode_chunk(chunk: BuiltChunk, compression: str, offset: int) -> tuple[bytes, bytes]:
    """Return a chunk with the indexes of its messages, as they stand in a file, and the summary's record of it.

    Parameters
    ----------
    chunk : BuiltChunk
        The content.
    compression : str
        `lz4`, `zstd`, or an empty string for none.
    offset : int
        Where in the file the chunk is to stand [bytes].
    """
    packed, name = _PACK[compression](chunk.data), compression.encode()
    head = _CHUNK.pack(*chunk.times_ns, len(chunk.data), zlib.crc32(chunk.data), len(name))
    size = len(head) + len(name) + _SIZE.size + len(packed)
    parts = [HEAD.pack(Opcode.CHUNK, size), head, name, _SIZE.pack(len(packed)), packed]
    indexes, places = _encoded_indexes(chunk.indexes, offset + HEAD.size + size)
    record = (
        _CHUNK_INDEX.pack(*chunk.times_ns, offset, HEAD.size + size, len(places)),
        places,
        _SIZE.pack(len(indexes)),
        CRC.pack(len(name)) + name,
        _SIZE.pack(len(packed)) + _SIZE.pack(len(chunk.data)),
    )
    return b"".join((*parts, indexes)), b"".join((HEAD.pack(Opcode.CHUNK_INDEX, sum(map(len, record))), *record))


def _encoded_indexes(indexes: Mapping[int, bytes], offset: int) -> tuple[bytes, bytes]:
    """Return the message indexes of a chunk, the first of which stands at `offset`, and where each of them stands."""
    parts: list[bytes] = []
    places: list[bytes] = []
    for channel, entries in indexes.items():
        places.append(_PLACE.pack(channel, offset))
        head = _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX.size - HEAD.size + len(entries), channel, len(entries))
        parts += (head, entries)
        offset += len(head) + len(entries)
    return b"".join(parts), b"".join(places)


def _with_declarations(
    parts: Sequence[bytes], offsets: Sequence[int], declared: Sequence[tuple[int, bytes]]
) -> tuple[list[bytes], list[int]]:
    """Return heads and data of messages with schemas and channels among them, and where the messages then are [bytes].

    Parameters
    ----------
    parts : sequence of bytes
        Head and data of each message, in turn.
    offsets : sequence of int
        Where each message is, and where the last one ends, without declarations [bytes].
    declared : sequence of (int, bytes)
        As for `build_chunk`.
    """
    before: list[list[bytes]] = [[] for _ in offsets]
    for place, record in declared:
        before[place].append(record)
    added = accumulate(sum(map(len, records)) for records in before)
    complete: list[bytes] = []
    for place, records in enumerate(before):
        complete += (*records, *parts[2 * place : 2 * place + 2])
    return complete, [offset + more for offset, more in zip(offsets, added, strict=True)]
