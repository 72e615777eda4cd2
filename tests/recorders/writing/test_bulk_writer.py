"""What a conversion writes is byte for byte what the library of MCAP's authors writes, and ends where it is to end."""

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.manifest import METADATA_NAME, content_sha256, to_metadata
from recorders.messages.record import RecordedMessage, publish_time_ns, published
from recorders.writing import bulk_writer
from recorders.writing.bulk_writer import BulkWriter

LARGE = 100  # bytes: a longer message stands beside the chunks
CHUNK = 250  # bytes
TEXT, NUMBER = ("std_msgs/msg/String", "ros2msg", b"string data"), ("Number", "jsonschema", b"{}")
CHANNELS = {
    "/a": DeclaredChannel("/a", "cdr", (("rate", "50"), ("by", "me")), TEXT),
    "/b": DeclaredChannel("/renamed", "json", schema=NUMBER),
    "/c": DeclaredChannel("/c", "cdr", schema=TEXT),
    "/d": DeclaredChannel("/c", "cdr", schema=TEXT),  # another name of the same
    "/e": DeclaredChannel("/e", ""),
}
TIMES = st.one_of(st.integers(0, 9), st.integers(0, 2**64 - 1))
SIZES = st.one_of(st.integers(0, LARGE + 20), st.sampled_from([LARGE, LARGE + 1]))
COMPRESSIONS = {"": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


@st.composite
def records(draw: st.DrawFn) -> RecordedMessage:
    topic, size = draw(st.sampled_from(sorted(CHANNELS))), draw(SIZES)
    data = bytes([draw(st.integers(0, 255))]) * size
    record = RecordedMessage(topic, CHANNELS[topic].type, data, draw(st.integers(0, 2**32 - 1)), draw(TIMES))
    return published(record, draw(TIMES)) if draw(st.booleans()) else record


class ByMcap:
    """One file, written with the library's own writer."""

    def __init__(self, compression: str) -> None:
        self.file = io.BytesIO()
        self.writer = Writer(self.file, compression=COMPRESSIONS[compression], enable_data_crcs=True)
        self.writer.start(profile="ros2", library="reenact")
        self.written: list[RecordedMessage] = []
        self.size = 0  # of the chunk's messages [bytes]
        self.progress: list[int] = []
        self.counted: dict[int, int] = {}  # channels in the order in which they are counted
        self.numbers, self.declarations = self._register()
        self._library("chunk_builder").reset()  # channels are declared once, before all chunks
        for number in dict.fromkeys(self.numbers.values()):
            self._beside(*self.declarations[number])

    def _library(self, name: str) -> Any:
        return getattr(self.writer, f"_Writer__{name}")

    def _register(self) -> tuple[dict[str, int], dict[int, list[Any]]]:
        schemas: dict[Any, Schema] = {}
        numbers: dict[DeclaredChannel, int] = {}
        declarations: dict[int, list[Any]] = {}
        for declared in dict.fromkeys(CHANNELS.values()):
            if declared.schema and declared.schema not in schemas:
                name, encoding, data = declared.schema
                schemas[declared.schema] = Schema(
                    id=self.writer.register_schema(name, encoding, data), name=name, encoding=encoding, data=data
                )
            of_channel = [schemas[declared.schema]] if declared.schema else []
            schema, metadata = (of_channel[0].id if of_channel else 0), dict(declared.metadata)
            number = self.writer.register_channel(declared.topic, declared.encoding, schema, metadata)
            channel = Channel(
                id=number,
                topic=declared.topic,
                message_encoding=declared.encoding,
                schema_id=schema,
                metadata=metadata,
            )
            numbers[declared], declarations[number] = number, [*of_channel, channel]
        return {topic: numbers[declared] for topic, declared in CHANNELS.items()}, declarations

    def _beside(self, *contents: Any) -> None:
        for content in contents:
            content.write(self._library("record_builder"))
        self._library("flush")()

    def end_chunk(self) -> None:
        if not self.size:
            return
        builder = self._library("chunk_builder")
        builder.message_indices = dict(sorted(builder.message_indices.items()))
        self.counted |= dict.fromkeys(builder.message_indices, 0)
        for index in builder.message_indices.values():
            index.records.sort(key=lambda entry: entry[0])  # by time alone
        self.writer.flush()
        self.size = 0
        self.progress.append(len(self.written))

    def add(self, record: RecordedMessage) -> bool:
        """Write a message; returns whether something has gone to the file."""
        number, data = self.numbers[record.topic], record.data
        times = record.log_time_ns, publish_time_ns(record)
        if len(data) <= LARGE:
            self.written.append(record)
            self.writer.add_message(number, times[0], data, times[1], record.sequence)
            self.size += 9 + 22 + len(data)
            if self.size < CHUNK:
                return False
            self.end_chunk()
            return True
        self.end_chunk()
        self.written.append(record)
        message = Message(
            channel_id=number, sequence=record.sequence, log_time=times[0], publish_time=times[1], data=data
        )
        self._beside(*self.declarations[number], message)
        statistics = self._library("statistics")
        first = statistics.message_start_time if statistics.message_count else times[0]
        statistics.message_start_time = min(first, times[0])
        statistics.message_end_time = max(statistics.message_end_time, times[0])
        statistics.message_count += 1
        statistics.channel_message_counts[number] += 1
        self.counted |= {number: 0}
        self.progress.append(len(self.written))
        return True

    def finish(self) -> bytes:
        self.end_chunk()
        named = [record._replace(topic=CHANNELS[record.topic].topic) for record in self.written]
        counts = Counter(record.topic for record in named)
        outcome = {"messages": len(named), "counts": dict(counts), "content_sha256": content_sha256(named)}
        self.writer.add_metadata(METADATA_NAME, to_metadata({"seed": 3, **outcome}))
        statistics = self._library("statistics")
        statistics.channel_message_counts = self.counted | statistics.channel_message_counts
        self.writer.finish()
        return self.file.getvalue()


def theirs(
    found: Sequence[RecordedMessage], compression: str, end_ns: int, most_bytes: int
) -> list[tuple[bytes, list[int], int]]:
    """Return each file, its progress, and how many messages there are up to its end."""
    files: list[tuple[bytes, list[int], int]] = []
    place = 0
    while place < len(found) or not files:
        log = ByMcap(compression)
        while place < len(found):
            if found[place].log_time_ns >= end_ns and log.written:
                break
            place += 1
            if log.add(found[place - 1]) and log.file.tell() >= most_bytes:
                break
        files.append((log.finish(), log.progress, place))
    return files


def ours(
    found: Sequence[RecordedMessage], compression: str, end_ns: int, most_bytes: int
) -> list[tuple[bytes, list[int], int]]:
    files: list[tuple[bytes, list[int], int]] = []
    rest: Iterator[RecordedMessage] = iter(found)
    place, following = 0, None
    while following is not None or not files:
        file, progress = io.BytesIO(), list[int]()
        writer = BulkWriter(
            file, CHANNELS, profile="ros2", compression=compression, chunk_bytes=CHUNK, on_chunk=progress.append
        )
        begin: list[RecordedMessage] = [] if following is None else [following]
        following = writer.write(
            (record for part in (begin, rest) for record in part), end_ns=end_ns, most_bytes=most_bytes
        )
        assert writer.counts.total() > 0 or not found
        place += writer.counts.total()
        assert following is (found[place] if place < len(found) else None)
        writer.finish({"seed": 3})
        files.append((file.getvalue(), progress, place))
    return files


@settings(max_examples=100)
@given(
    found=st.lists(records(), max_size=40),
    compression=st.sampled_from(sorted(COMPRESSIONS)),
    end_ns=st.one_of(st.integers(0, 9), st.just(2**64)),
    most_bytes=st.one_of(st.integers(0, 3000), st.just(2**63)),
)
def test_files_are_those_of_the_library(
    found: list[RecordedMessage], compression: str, end_ns: int, most_bytes: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bulk_writer, "LARGE", LARGE)
        assert ours(found, compression, end_ns, most_bytes) == theirs(found, compression, end_ns, most_bytes)


def test_a_chunk_ends_where_it_has_a_mebibyte_unless_another_size_is_given() -> None:
    progress: list[int] = []
    writer = BulkWriter(io.BytesIO(), CHANNELS, profile="", on_chunk=progress.append)
    half = 2**19 - 31  # with 31 bytes beside its data a message
    sizes = [half, half - 1, 0, half, half - 1, 0, half, half]
    found = [RecordedMessage("/a", "", bytes(size), 0, 0) for size in sizes]
    assert writer.write(iter(found), end_ns=1, most_bytes=2**63) is None
    assert progress == [3, 6, 8]


@pytest.mark.parametrize(("more", "written"), [(0, 1), (1, 2)])
def test_a_file_that_has_the_size_takes_no_more(more: int, written: int) -> None:
    first, second = (RecordedMessage("/a", "", bytes(CHUNK), number, 0) for number in range(2))
    sizes: list[int] = []
    for most_bytes in (0, more):
        writer = BulkWriter(file := io.BytesIO(), CHANNELS, profile="", compression="", chunk_bytes=CHUNK)
        following = writer.write(iter([first, second]), end_ns=1, most_bytes=most_bytes + sum(sizes))
        sizes.append(file.tell())
    assert writer.counts.total() == written
    assert following is (second if written == 1 else None)
