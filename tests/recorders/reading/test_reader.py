import os
import random
import subprocess
import sys
from collections import Counter
from contextlib import suppress

import pytest
from chunk_ends import chunk_ends, whole_before
from every_record import write_every_record
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from recorders.errors import LogError
from recorders.mcap_format.records import MAGIC
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, SAMPLE_JOINTS, TOPICS
from recorders.reading.reader import LogReader


def read_until_damage(path):
    """Return the records before the damage, and the error's text (None if there was none)."""
    records = []
    try:
        for record in LogReader(path):
            records.append(record)  # one by one: the last step may raise
    except LogError as error:
        return records, str(error)
    return records, None


def test_records_come_in_file_order_with_their_own_bytes(log, ticks):
    assert list(LogReader(log)) == ticks(40)
    assert all(type(record) is RecordedMessage for record in LogReader(log))


def test_topics_filter(log, ticks):
    wanted = [LEFT_TARGET, SAMPLE_JOINTS]
    assert list(LogReader(log).records(topics=wanted)) == [record for record in ticks(40) if record.topic in wanted]
    assert list(LogReader(log).records(topics=["/none"])) == []


def test_contents(log, ticks):
    reader = LogReader(log)
    assert reader.counts == Counter(record.topic for record in ticks(40))
    assert reader.topics == {name: TOPICS[name].type for name in reader.counts}
    assert reader.attachments == ("robot.urdf",)
    assert reader.attachment("robot.urdf") == b"<robot/>"
    with pytest.raises(LogError, match=r"no attachment 'robot.toml'; there are: robot.urdf"):
        reader.attachment("robot.toml")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "no such file"),
        (b"", "expected an MCAP file, found an empty one"),
        (
            b"PK\x03\x04 and more",
            "expected an MCAP file, found one that begins with 'PK.*: a zip archive, as a",
        ),
    ],
)
def test_what_is_not_a_log_is_refused_at_once(tmp_path, content, expected):
    path = tmp_path / "log.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LogError, match=f"log.mcap: {expected}"):
        LogReader(path)


def test_a_directory_is_refused(tmp_path):
    with pytest.raises(LogError, match="expected an MCAP file, found a directory"):
        LogReader(tmp_path)


def test_a_cut_off_log_gives_everything_before_the_cut_and_one_error(log, tmp_path, ticks):
    whole = log.read_bytes()
    expected = ticks(40)
    cut = tmp_path / "cut.mcap"
    lengths = set()
    for size in sorted(random.Random(0).sample(range(8, len(whole)), 150)):
        cut.write_bytes(whole[:size])
        records, error = read_until_damage(cut)
        assert records == expected[: len(records)]
        assert "cut off at byte" in error
        assert "\n" not in error
        lengths.add(len(records))
        with pytest.raises(LogError, match=r"cut.mcap: the log is cut off"):
            _ = LogReader(cut).manifest
    assert {0, 64, 128, 192, 256, 280} == lengths


def test_a_flipped_bit_never_gives_a_wrong_message(log, tmp_path, ticks):
    whole = log.read_bytes()
    expected = ticks(40)
    bad = tmp_path / "bad.mcap"
    draw = random.Random(1)
    for place in draw.sample(range(8, len(whole)), 200):
        raw = bytearray(whole)
        raw[place] ^= 1 << draw.randrange(8)
        bad.write_bytes(raw)
        records, error = read_until_damage(bad)
        assert records == expected[: len(records)]
        assert len(records) >= whole_before(chunk_ends(log), place)
        assert error is not None
        assert "\n" not in error
        for ask in (lambda: LogReader(bad).manifest, lambda: LogReader(bad).attachment("robot.urdf")):
            with suppress(LogError):
                assert ask() in (LogReader(log).manifest, b"<robot/>")


def test_a_damaged_attachment_is_refused(log, tmp_path):
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(log.read_bytes().replace(b"<robot/>", b"<rabot/>"))
    with pytest.raises(LogError, match=r"bad.mcap: the log is damaged at byte \d+: the CRC of an attachment does not"):
        LogReader(bad).attachment("robot.urdf")


def test_huge_lengths_are_refused_without_allocating(log, tmp_path):
    whole = log.read_bytes()
    bad = tmp_path / "bad.mcap"
    chunk = whole.index(b"\3\0\0\0lz4") - 4 - 8 - 16 - 8  # the length field of the first chunk
    for place, text in ((chunk, "cut off"), (chunk + 8 + 16, "claims 1152921504606846976 bytes")):
        raw = bytearray(whole)
        raw[place : place + 8] = (2**60).to_bytes(8, "little")
        bad.write_bytes(raw)
        records, error = read_until_damage(bad)
        assert records == []
        assert text in error


def test_a_log_that_vanishes_is_one_error(log):
    reader = LogReader(log)
    log.unlink()
    with pytest.raises(LogError, match="no such file"):
        list(reader)


def foreign(path, **options):
    """Write a log as other programs do, with a protobuf, a JSON and a schemaless channel."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="", library="other")
        protobuf = writer.register_schema("foxglove.PoseInFrame", "protobuf", b"\x00descriptor")
        json_schema = writer.register_schema("Note", "jsonschema", b"{}")
        channels = [
            writer.register_channel("/pose", "protobuf", protobuf),
            writer.register_channel("/note", "json", json_schema),
            writer.register_channel("/raw", "x", 0),
        ]
        for index in range(30):
            writer.add_message(channels[index % 3], 100 - index, bytes([index]) * index, 5, index)
        writer.add_metadata("other", {"a": "b"})
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"hello")
        writer.finish()
    types = ["foxglove.PoseInFrame", "Note", ""]
    topics = ["/pose", "/note", "/raw"]
    return [RecordedMessage(topics[i % 3], types[i % 3], bytes([i]) * i, i, 100 - i) for i in range(30)]


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", CompressionType)
def test_logs_of_other_writers_are_read_raw(tmp_path, compression, chunked, indexed):
    path = tmp_path / "foreign.mcap"
    bare = {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    }
    records = foreign(path, compression=compression, use_chunking=chunked, chunk_size=200, **({} if indexed else bare))
    reader = LogReader(path)
    assert list(reader) == sorted(records, key=lambda record: record.log_time_ns)
    assert list(reader.records(file_order=True)) == records
    assert reader.counts == {"/pose": 10, "/note": 10, "/raw": 10}
    assert reader.topics == {"/pose": "foxglove.PoseInFrame", "/note": "Note", "/raw": ""}
    assert reader.manifest == {}
    assert reader.attachment("notes.txt") == b"hello"


times = st.lists(st.integers(0, 40), max_size=30)
bounds = st.tuples(st.integers(-1, 45), st.integers(-1, 45))
same_file = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], derandomize=True
)


def write_times(path, times_ns, draw):
    """Write messages of these log times on two topics, in small chunks or none, with attachments between them."""
    options = {"chunk_size": draw(st.sampled_from([1, 120, 400])), "use_chunking": draw(st.integers(0, 3)) > 0}
    with path.open("wb") as file:
        writer = Writer(file, compression=draw(st.sampled_from(list(CompressionType))), **options)
        writer.start(profile="", library="other")
        channels = [writer.register_channel(topic, "x", 0) for topic in ("/even", "/odd")]
        for index, time_ns in enumerate(times_ns):
            writer.add_message(channels[index % 2], time_ns, bytes(index), 0, index)
            if index % 7 == 6:
                writer.add_attachment(0, 0, f"{index}", "text/plain", b"between")
        writer.finish()


@same_file
@given(times, bounds, st.sampled_from([None, ["/even"], ["/odd", "/none"]]), st.data())
def test_a_slice_is_what_a_filter_leaves(tmp_path, times_ns, bound, topics, data):
    path = tmp_path / "log.mcap"
    write_times(path, times_ns, data.draw)
    start, end = bound
    expected = [
        record
        for record in LogReader(path)
        if start <= record.log_time_ns < end and (topics is None or record.topic in topics)
    ]
    assert list(LogReader(path).records(topics=topics, start_ns=start, end_ns=end)) == expected


def test_a_slice_reads_only_the_chunks_that_overlap(log, ticks, tmp_path):
    raw = log.read_bytes()
    first = raw.index(b"\3\0\0\0lz4") + 30
    path = tmp_path / "bad.mcap"
    path.write_bytes(raw[:first] + bytes(20) + raw[first + 20 :])
    half = 20 * 50_000_000
    assert list(LogReader(path).records(start_ns=half)) == [item for item in ticks(40) if item.log_time_ns >= half]
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(path).records(end_ns=half))


def test_without_an_index_a_slice_is_read_from_the_whole(log, ticks, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:-1])
    records, inside = [], [item for item in ticks(40) if item.log_time_ns >= 10**9]
    with pytest.raises(LogError, match="cut off"):  # noqa: PT012  one by one: the last step raises
        for record in LogReader(cut).records(start_ns=10**9):
            records.append(record)
    assert records == inside


def test_the_messages_of_one_huge_chunk_come_one_by_one(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2**30, compression=CompressionType.ZSTD)
        writer.start(profile="", library="other")
        channel = writer.register_channel("/x", "x", 0)
        for index in range(50_000):
            writer.add_message(channel, index, bytes(100), 0, index)
        writer.finish()
    assert [item.sequence for item in LogReader(path)] == list(range(50_000))


def ask_everything(path):
    """Ask a log for all that it has; only a LogError is let pass."""
    with suppress(LogError):
        reader = LogReader(path)
        for ask in (
            lambda: Counter(reader),
            lambda: Counter(reader.records(topics=["/topic/1"], start_ns=5, end_ns=2**62)),
            lambda: (reader.counts, reader.topics, reader.manifest),
            lambda: [reader.attachment(name) for name in reader.attachments],
            lambda: reader.protected,
        ):
            with suppress(LogError):
                ask()


@same_file
@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_raise_nothing_but_our_error(tmp_path, raw, begun):
    path = tmp_path / "random.mcap"
    path.write_bytes(MAGIC * begun + raw)
    ask_everything(path)


@same_file
@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1), st.binary(max_size=40)), max_size=4))
def test_mutated_logs_raise_nothing_but_our_error(tmp_path, changes):
    path = tmp_path / "mutated.mcap"
    write_every_record(path)
    raw = path.read_bytes()
    for where, length, found in changes:  # runs of bytes replaced by others, shorter or longer
        place = int(where * len(raw))
        raw = raw[:place] + found + raw[place + int(length * 60) :]
    path.write_bytes(raw)
    ask_everything(path)


def test_memory_does_not_grow_with_the_log(tmp_path):
    small, large = (_peak_kib(tmp_path / f"{count}.mcap", count) for count in (2_000, 200_000))
    assert large - small < 8 * 1024  # the large log is 80 MB of messages


def _peak_kib(path, count):
    write = (
        "import sys; from recorders.writing.writer import LogWriter; data = bytes(400)\n"
        "with LogWriter(sys.argv[1], manifest={}) as log:\n"
        "    for k in range(int(sys.argv[2])):\n"
        f"        log.write('/x', data, log_time_ns=k, type_name={PoseStamped.TYPE!r})\n"
    )
    read = (
        "import sys, resource; from recorders.reading.reader import LogReader\n"
        "assert sum(1 for _ in LogReader(sys.argv[1])) == int(sys.argv[2])\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n"
    )
    subprocess.run([sys.executable, "-c", write, path, str(count)], check=True)
    done = subprocess.run([sys.executable, "-c", read, path, str(count)], check=True, capture_output=True)
    return int(done.stdout)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(LogError, match=r"pipe.mcap: expected an MCAP file, found a pipe"):
        LogReader(tmp_path / "pipe.mcap")
