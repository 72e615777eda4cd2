"""The container `.bag` of ROS 1 (version 2.0), indexed: chunks of messages, by their times.

The format: http://wiki.ros.org/Bags/Format/2.0.
"""

import bz2
import heapq
import os
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

from recorders.containers.foreign_reader import ForeignReader
from recorders.errors import LogError, unreadable
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.decompression import DECOMPRESS_ERRORS, decompress
from recorders.mcap_format.lengths import MAX_CHUNK, MAX_DECLARED
from recorders.messages.record import RecordedMessage
from recorders.reading.file_kind import ROS1_MAGIC
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.time_order import MOST_HELD

_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = b"\x02", b"\x03", b"\x05", b"\x06", b"\x07"
_LENGTH = struct.Struct("<I")
_OFFSET = struct.Struct("<Q")
_TIME = struct.Struct("<II")
_COUNT = struct.Struct("<II")
_MOST_HEADER = 2**20  # bytes
_SECOND = 10**9

_OVERHEAD = 300  # bytes that a message takes beside its own

_Header: TypeAlias = dict[bytes, bytes]

# log time [ns], offset of the chunk, place in it, connection, data
_Waiting: TypeAlias = tuple[int, int, int, int, bytes]


class _ChunkInfo(NamedTuple):
    """Where a chunk stands, from which time to which its messages are [ns], and how many of each connection."""

    first_ns: int
    offset: int
    last_ns: int
    counts: dict[int, int]


class _Damaged(Exception):
    """The bag is not what its format says."""


class Ros1Bag(ForeignReader):
    """Reader of one `.bag` file; a chunk is held from its first message to its last.

    Raises
    ------
    LogError
        If it is no such file, or has no index. From every method: if it is damaged.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file = path
        with self._open() as file:
            if file.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
                raise LogError(f"{path}: expected a ROS 1 bag of version 2.0, found none")
            header, _ = _record(file)
            self._index = _number(header, b"index_pos", _OFFSET)
            self._connections = _number(header, b"conn_count", _LENGTH)
            self._chunks = _number(header, b"chunk_count", _LENGTH)
        if header.get(b"encryptor"):
            raise LogError(f"{path}: expected a bag that is not encrypted, found one that is; decrypt it with rosbag")
        if not self._index:
            raise LogError(f"{path}: its recorder was cut off before it wrote the index; `rosbag reindex` makes one")

    @cached_property
    def _contents(self) -> tuple[dict[int, DeclaredChannel], list[_ChunkInfo]]:
        channels: dict[int, DeclaredChannel] = {}
        with self._open() as file:
            _seek(file, self._index)
            for _ in range(self._connections):
                number, channel = _channel(*_record(file))
                channels[number] = channel
                if file.tell() - self._index > MAX_DECLARED:
                    raise _Damaged(f"more than {MAX_DECLARED} bytes of connections, the most that is held")
            infos = [_chunk_info(*_record(file)) for _ in range(self._chunks)]
        return channels, infos

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, with its schema: one for each connection, of which a topic may have several."""
        return tuple(dict.fromkeys(self._contents[0].values()))

    @cached_property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any, by the index."""
        channels, infos = self._contents
        found: dict[str, int] = {}
        for info in infos:
            for number, count in info.counts.items():
                if number in channels and count:
                    found[channels[number].topic] = found.get(channels[number].topic, 0) + count
        return found

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`."""
        channels, infos = self._contents
        wanted = None if topics is None else frozenset(topics)
        chosen = {
            number: (channel.topic, channel.type) if wanted is None or channel.topic in wanted else None
            for number, channel in channels.items()
        }
        asked = {number for number, named in chosen.items() if named is not None}
        infos = [
            info
            for info in infos
            if info.first_ns < end_ns and info.last_ns >= start_ns and (wanted is None or asked & info.counts.keys())
        ]
        if file_order:
            infos.sort(key=lambda info: info.offset)
        else:
            infos.sort()
        with self._open() as file:
            chunks = self._in_turn(file, infos) if file_order else self._by_time(file, infos)
            for time_ns, number, data in chunks:
                if number not in chosen:
                    raise _Damaged(f"a message is of connection {number}, which is not declared")
                named = chosen[number]
                if named is not None and start_ns <= time_ns < end_ns:
                    yield RecordedMessage(*named, data, 0, time_ns)

    def _in_turn(self, file: BinaryIO, infos: list[_ChunkInfo]) -> Iterator[tuple[int, int, bytes]]:
        for info in infos:
            yield from _messages(_chunk_data(file, info.offset))

    def _by_time(self, file: BinaryIO, infos: list[_ChunkInfo]) -> Iterator[tuple[int, int, bytes]]:
        """Yield time, connection and data of the messages by time, those of one time in the order of the file."""
        waiting: list[_Waiting] = []  # a heap
        held = 0
        for info in infos:
            while waiting and waiting[0][0] < info.first_ns:
                time_ns, _, _, number, message = heapq.heappop(waiting)
                held -= len(message) + _OVERHEAD
                yield time_ns, number, message
            for place, (time_ns, number, message) in enumerate(_messages(_chunk_data(file, info.offset))):
                if not info.first_ns <= time_ns <= info.last_ns:
                    raise _Damaged("a chunk is of other times than its index states; `rosbag reindex` makes a new one")
                heapq.heappush(waiting, (time_ns, info.offset, place, number, message))
                held += len(message) + _OVERHEAD
            if held > MOST_HELD:
                raise _Damaged(f"more than {MOST_HELD // 10**6} MB of chunks that overlap in time; sort the bag first")
        while waiting:
            time_ns, _, _, number, message = heapq.heappop(waiting)
            yield time_ns, number, message

    @contextmanager
    def _open(self) -> Iterator[BinaryIO]:
        try:
            with self._file.open("rb") as file:
                yield file
        except (_Damaged, struct.error, UnicodeDecodeError) as error:
            raise LogError(f"{self.path}: the bag is damaged: {error}") from None
        except OSError as error:
            raise LogError(unreadable(self.path, error)) from error


def _seek(file: BinaryIO, offset: int) -> None:
    size = os.fstat(file.fileno()).st_size
    if offset >= size:
        raise _Damaged(f"it names a record at byte {offset}, and ends at byte {size}")
    file.seek(offset)


def _record(file: BinaryIO) -> tuple[_Header, bytes]:
    """Read one record: its header and its data."""
    header = _header(_sized(file, _MOST_HEADER))
    most = MAX_CHUNK if header.get(b"op") == _CHUNK else _MOST_HEADER
    return header, _sized(file, most)


def _sized(file: BinaryIO, most: int) -> bytes:
    (size,) = _LENGTH.unpack(file.read(4))
    if size > most:
        raise _Damaged(f"a record of {size} bytes, and {most} is the most")
    data = file.read(size)
    if len(data) != size:
        raise _Damaged("it is cut off")
    return data


def _header(data: bytes) -> _Header:
    fields, position = _Header(), 0
    while position < len(data):
        (size,) = _LENGTH.unpack_from(data, position)
        name, equals, value = data[position + 4 : position + 4 + size].partition(b"=")
        position += 4 + size
        if not equals or position > len(data):
            raise _Damaged("a header is malformed")
        fields[name] = value
    return fields


def _number(header: _Header, name: bytes, form: struct.Struct) -> int:
    found: int = form.unpack(header.get(name, b""))[0]
    return found


def _time_ns(value: bytes) -> int:
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds) * _SECOND + int(nanoseconds)


def _channel(header: _Header, data: bytes) -> tuple[int, DeclaredChannel]:
    if header.get(b"op") != _CONNECTION:
        raise _Damaged("its index holds another record where a connection is expected")
    about = {name.decode(): value for name, value in _header(data).items()}
    topic = header.get(b"topic", b"").decode()
    metadata = tuple((name, about[name].decode()) for name in ("callerid", "latching", "md5sum") if name in about)
    schema = about.get("type", b"").decode(), "ros1msg", about.get("message_definition", b"")
    return _number(header, b"conn", _LENGTH), DeclaredChannel(topic, "ros1", metadata, schema)


def _chunk_info(header: _Header, data: bytes) -> _ChunkInfo:
    if header.get(b"op") != _CHUNK_INFO or header.get(b"ver") != _LENGTH.pack(1):
        raise _Damaged("its index holds another record where a chunk's is expected")
    first_ns, last_ns = _time_ns(header.get(b"start_time", b"")), _time_ns(header.get(b"end_time", b""))
    counts = dict(_COUNT.iter_unpack(data))
    return _ChunkInfo(first_ns, _number(header, b"chunk_pos", _OFFSET), last_ns, counts)


def _chunk_data(file: BinaryIO, offset: int) -> bytes:
    _seek(file, offset)
    header, data = _record(file)
    size = _number(header, b"size", _LENGTH)
    if header.get(b"op") != _CHUNK or size > MAX_CHUNK:
        raise _Damaged(f"expected a chunk of at most {MAX_CHUNK} bytes at byte {offset}, found another record")
    compression = header.get(b"compression", b"").decode()
    try:
        if compression != "bz2":
            return decompress(data, "" if compression == "none" else compression, size)
        found = bz2.BZ2Decompressor().decompress(data, size + 1)
    except (*DECOMPRESS_ERRORS, OSError) as error:
        raise _Damaged(f"the chunk at byte {offset} does not decompress: {error}") from None
    if len(found) != size:
        raise _Damaged(f"the chunk at byte {offset} holds {len(found)} bytes and claims {size}")
    return found


def _messages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield time [ns], connection and data of each message in the data of a chunk."""
    position, unpack = 0, _LENGTH.unpack_from
    while position < len(data):
        (size,) = unpack(data, position)
        header = _header(data[position + 4 : position + 4 + size])
        position += 4 + size
        (size,) = unpack(data, position)
        end = position + 4 + size
        if end > len(data):
            raise _Damaged("a message is cut off")
        if header.get(b"op") == _MESSAGE:
            yield _time_ns(header.get(b"time", b"")), _number(header, b"conn", _LENGTH), data[position + 4 : end]
        position = end
