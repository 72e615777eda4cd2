"""Chunks are encoded here, and are byte for byte those of the library of MCAP's authors."""

import io

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from recorders.writing.mcap_writer import McapWriter

TIMES = st.integers(0, 2**64 - 1)
MESSAGES = st.tuples(st.integers(0, 30), st.integers(0, 2**32 - 1), TIMES, TIMES, st.binary(max_size=300))
STEPS = st.lists(st.one_of(st.sampled_from(["schema", "channel", "metadata", "flush"]), MESSAGES), max_size=60)


def theirs(steps: list[object], chunk_size: int) -> bytes:
    """Return the file that the library makes."""
    file, channels, schemas = io.BytesIO(), 0, 0
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
            case (int(place), int(sequence), int(log_time), int(publish_time), bytes(data)) if channels:
                writer.add_message(1 + place % channels, log_time, data, publish_time, sequence)
    writer.finish()
    return file.getvalue()


def ours(steps: list[object], chunk_size: int) -> tuple[bytes, dict[int, int]]:
    """Return the file that our writer makes, and what it counts by channel."""
    file, channels, schemas = io.BytesIO(), 0, 0
    writer = McapWriter(file, chunk_size=chunk_size)
    for step in steps:
        match step:
            case "schema":
                schemas = writer.register_schema(f"type_{schemas}", "ros2msg", bytes(schemas))
            case "channel":
                channels = writer.register_channel(f"/topic_{channels}", "cdr", schemas, {"a": "b"})
            case "metadata":
                writer.add_metadata("note", {"c": "d"})
            case "flush":
                writer.flush()
            case (int(place), int(sequence), int(log_time), int(publish_time), bytes(data)) if channels:
                writer.add_message((1 + place % channels, sequence, log_time, publish_time, data))
    writer.finish()
    return file.getvalue(), dict(writer.counts)


@settings(max_examples=200, deadline=None)
@given(steps=STEPS, begin=st.lists(st.just("channel"), max_size=3), chunk_size=st.integers(0, 2000))
def test_a_file_is_that_of_the_library(steps: list[object], begin: list[object], chunk_size: int) -> None:
    data, counts = ours([*begin, *steps], chunk_size)
    assert data == theirs([*begin, *steps], chunk_size)
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert counts == summary.statistics.channel_message_counts
