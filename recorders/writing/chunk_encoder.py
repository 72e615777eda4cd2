"""Chunks of a log, encoded whole: the messages of many calls with one call each of what is written in C."""

import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import accumulate, chain, repeat
from operator import add
from typing import NamedTuple, TypeAlias

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from recorders.mcap_format.chunk_contents import MESSAGE
from recorders.mcap_format.records import CRC, HEAD

Pending: TypeAlias = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns] and data of a message."""

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


def build_chunk(pending: Sequence[Pending], declared: Sequence[tuple[int, bytes]] = ()) -> BuiltChunk:
    """Put the records of a chunk together.

    Parameters
    ----------
    pending : sequence of Pending
        One message or more, in their order.
    declared : sequence of (int, bytes)
        Records of schemas and channels, each with how many messages stand before it.
    """
    channels, sequences, times, publish_times, datas = zip(*pending, strict=True)
    lengths = list(map(len, datas))
    bodies = map(add, lengths, repeat(MESSAGE.size))
    heads = map(RECORD.pack, repeat(int(Opcode.MESSAGE)), bodies, channels, sequences, times, publish_times)
    sizes = [length + RECORD_SIZE for length in lengths]
    offsets: Iterator[int]
    if declared:
        data, offsets = _with_declarations(heads, datas, sizes, declared)
    else:
        data = b"".join(chain.from_iterable(zip(heads, datas, strict=True)))
        offsets = accumulate(sizes, initial=0)
    entries: defaultdict[int, list[bytes]] = defaultdict(list)
    for channel, entry in zip(channels, map(_ENTRY.pack, times, offsets), strict=False):  # offsets has the end, too
        entries[channel].append(entry)
    indexes = {channel: b"".join(of_channel) for channel, of_channel in entries.items()}
    return BuiltChunk(data, (min(times), max(times)), indexes)


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
    heads: Iterator[bytes], datas: Sequence[bytes], sizes: Sequence[int], declared: Sequence[tuple[int, bytes]]
) -> tuple[bytes, Iterator[int]]:
    """Return the content of a chunk in which schemas and channels stand, and where its messages are [bytes]."""
    before: list[list[bytes]] = [[] for _ in range(len(datas) + 1)]
    for place, record in declared:
        before[place].append(record)
    parts: list[bytes] = []
    offsets, offset = [], 0
    for records, head, data, size in zip(before, heads, datas, sizes, strict=False):
        parts += (*records, head, data)
        offset += sum(map(len, records))
        offsets.append(offset)
        offset += size
    return b"".join((*parts, *before[-1])), iter(offsets)
