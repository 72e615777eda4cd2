"""Chunks are encoded here, and are byte for byte those of the library of MCAP's authors."""

import io
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from recorders.mcap_format.attachments import AttachmentHead
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.mcap_format.unread import Unread
from recorders.writing.chunk_index_file import ChunkIndexFile
from recorders.writing.mcap_writer import McapWriter

TIMES = st.integers(0, 2**64 - 1)
MESSAGES = st.tuples(st.integers(0, 30), st.integers(0, 2**32 - 1), TIMES, TIMES, st.binary(max_size=300))
STEPS = st.lists(
    st.one_of(st.sampled_from(["schema", "channel", "metadata", "flush"]), MESSAGES, st.binary(max_size=50)),
    max_size=60,
)
SENT = tuple[int, int, int, int, bytes]


def theirs(steps: Sequence[object], chunk_size: int = 2**20, chunk_messages: int = 2**63) -> bytes:
    """Return the file that the library makes."""
    file, channels, schemas, messages = io.BytesIO(), 0, 0, 0
    writer = Writer(file, compression=CompressionType.LZ4, chunk_size=chunk_size, enable_data_crcs=True)
    writer.start(profile="ros2", library="reenact")
    for step in steps:
        match step:
            case "schema":
                schemas = writer.register_schema(f"type_{schemas}", "ros2msg", bytes(schemas))
            case "channel":
                channels = writer.register_channel(f"/topic_{channels}", "cdr", schemas, {"a": "b"})
            case "metadata":
                writer.flush()
                writer.add_metadata("note", {"c": "d"})
            case "flush":
                writer.flush()
            case bytes(data):
                writer.flush()
                writer.add_attachment(3, 4, "café.txt", "text/plain", data)
            case (int(place), int(sequence), int(log_time), int(publish_time), bytes(data)) if channels:
                writer.add_message(1 + place % channels, log_time, data, publish_time, sequence)
                messages += 1
                if messages % chunk_messages == 0:
                    writer.flush()
    writer.finish()
    return file.getvalue()


def ours(
    steps: Sequence[object], index: ChunkIndexFile | None = None, **limits: int
) -> tuple[bytes, dict[int, int], list[SENT]]:
    """Return the file that our writer makes, what it counts by channel, and the messages of its chunks."""
    file, channels, schemas = io.BytesIO(), 0, 0
    chunks: list[MessageColumns] = []
    writer = McapWriter(file, index=index, on_chunk=chunks.append, **limits)
    for step in steps:
        match step:
            case "schema":
                schemas = writer.register_schema(f"type_{schemas}", "ros2msg", bytes(schemas))
            case "channel":
                channels = writer.register_channel(f"/topic_{channels}", "cdr", schemas, {"a": "b"})
            case "metadata":
                writer.add_metadata("note", {"c": "d"})
            case "flush":
                waiting = len(writer.pending)
                assert writer.end_chunk() == (waiting > 0)
            case bytes(data):
                writer.add_attachment(
                    AttachmentHead(4, 3, "café.txt", "text/plain", 0, len(data)), [data[:7], memoryview(data)[7:]]
                )
            case (int(place), int(sequence), int(log_time), int(publish_time), bytes(data)) if channels:
                before = writer.messages
                writer.add_message((1 + place % channels, sequence, log_time, publish_time, data))
                assert writer.messages == before + 1
    writer.finish()
    assert writer.pending == []
    sent = [message for chunk in chunks for message in zip(*chunk[:5], strict=True)]
    return file.getvalue(), dict(writer.counts), sent


@settings(max_examples=200)
@given(
    steps=STEPS,
    begin=st.lists(st.just("channel"), max_size=3),
    chunk_size=st.integers(0, 2000),
    chunk_messages=st.one_of(st.integers(1, 20), st.just(2**63)),
)
def test_a_file_is_that_of_the_library(
    steps: list[object],
    begin: list[object],
    chunk_size: int,
    chunk_messages: int,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    index = ChunkIndexFile(tmp_path_factory.getbasetemp() / "log.mcap")
    try:
        data, counts, sent = ours([*begin, *steps], index, chunk_size=chunk_size, chunk_messages=chunk_messages)
        in_index = b"".join(records.data for records in index)
    finally:
        index.close()
    assert data == theirs([*begin, *steps], chunk_size, chunk_messages)
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert counts == summary.statistics.channel_message_counts
    assert in_index in data
    assert bool(in_index) == bool(summary.chunk_indexes)  # and so not in the memory
    assert len(sent) == summary.statistics.message_count
    if begin:
        assert [message[1:] for message in sent] == [step[1:] for step in steps if isinstance(step, tuple)]


def test_a_chunk_ends_where_it_is_longer_than_a_mebibyte_unless_another_size_is_given() -> None:
    for size in range(2**20 - 116, 2**20 - 108):  # the declarations take the rest
        steps = ["schema", "channel", (0, 0, 1, 1, bytes(size)), (0, 1, 2, 2, b"")]
        assert ours(steps)[0] == theirs(steps)


def test_a_message_of_which_a_part_is_in_another_file_is_written_whole_behind_what_came_before() -> None:
    files: list[bytes] = []
    for data, rest in ((b"abcdefg", None), (b"ab", Unread(io.BytesIO(b"###cdefg##"), 3, 5))):
        writer = McapWriter(file := io.BytesIO())
        channel = writer.register_channel("/x", "", 0, {})
        writer.add_message((channel, 6, 9, 9, b"before"))
        writer.add_message_in_pieces(channel, 7, 5, 4, data, rest)
        writer.finish()
        files.append(file.getvalue())
    assert files[0] == files[1]
    found = [each for each in StreamReader(io.BytesIO(files[0])).records if isinstance(each, Message)]
    assert [(each.sequence, each.data) for each in found] == [(6, b"before"), (7, b"abcdefg")]
    statistics = make_reader(io.BytesIO(files[0])).get_summary().statistics
    assert (statistics.message_count, statistics.message_start_time, statistics.message_end_time) == (2, 5, 9)


def test_a_chunk_of_any_size_ends_with_the_record_that_makes_it_longer() -> None:
    steps = ["channel", *[(0, 0, 1, 1, b"abc"), "schema", (0, 1, 2, 2, b""), "channel"] * 2, "flush", (1, 2, 3, 3, b"")]
    for size in range(400):
        assert ours(steps, chunk_size=size)[0] == theirs(steps, chunk_size=size)
