"""Messages come in order of log time, whatever the order of the file, in memory that what overlaps bounds."""

import struct
import tracemalloc
import zlib
from contextlib import suppress
from itertools import accumulate

import pytest
import zstandard
from every_record import packed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Message, MessageIndex, Statistics
from mcap.writer import CompressionType, IndexType, Writer

from recorders.errors import LogError
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.records import MAGIC
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader
from recorders.reading.time_order import MOST_HELD
from recorders.recovery.recover import recover
from recorders.writing.writer import LogWriter

HEADER = Header("", "other")
CHANNELS = [Channel(1, "/even", "x", {}, 0), Channel(2, "/odd", "x", {}, 0)]
BARE = {
    "index_types": IndexType.NONE,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
}
few = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], derandomize=True, max_examples=60
)


def by_time(records):
    return sorted(records, key=lambda record: record.log_time_ns)  # of one time as they came


def message(index, time_ns, size=8):
    return Message(1 + index % 2, time_ns, index.to_bytes(4, "little") * (size // 4), 0, index)


def stamped(messages):
    return [RecordedMessage(CHANNELS[m.channel_id - 1].topic, "", m.data, m.sequence, m.log_time) for m in messages]


def chunk(messages, *, stated=None, declared=(), squeeze=None):
    """Return a chunk of messages as bytes; `stated` are other times than theirs."""
    data = packed(*declared, *messages)
    times = stated or [m.log_time for m in messages]
    compression, kept = ("zstd", zstandard.compress(data)) if squeeze else ("", data)
    return packed(Chunk(compression, kept, max(times), min(times), zlib.crc32(data), len(data)))


def put(path, *parts):
    """Write a log without a summary."""
    raw = MAGIC + packed(HEADER) + b"".join(parts)
    path.write_bytes(raw + packed(DataEnd(zlib.crc32(raw)), Footer(0, 0, 0)) + MAGIC)
    return path


def until_damage(records):
    """Return the records before the damage, and the error (None if there was none)."""
    found = []
    try:
        for record in records:
            found.append(record)  # one by one: the last step may raise
    except LogError as error:
        return found, error
    return found, None


def write(path, times_ns, draw):
    """Write a log as other programs do, in chunks or without, indexed or not; return the messages as they stand."""
    options = {
        "chunk_size": draw(st.sampled_from([1, 120, 600, 2**20])),
        "use_chunking": draw(st.integers(0, 3)) > 0,
        "compression": draw(st.sampled_from(list(CompressionType))),
        "enable_data_crcs": draw(st.booleans()),
    }
    with path.open("wb") as file:
        writer = Writer(file, **options, **(BARE if draw(st.booleans()) else {}))
        writer.start(profile="", library="other")
        channels = [writer.register_channel(topic, "x", 0) for topic in ("/even", "/odd")]
        for index, time_ns in enumerate(times_ns):
            writer.add_message(channels[index % 2], time_ns, bytes(index), 0, index)
            if index % 7 == 6:
                writer.add_attachment(0, 0, f"{index}", "text/plain", b"between")
        writer.finish()
    return [RecordedMessage(("/even", "/odd")[k % 2], "", bytes(k), k, time_ns) for k, time_ns in enumerate(times_ns)]


@few
@given(
    st.lists(st.integers(0, 12), max_size=40) | st.lists(st.integers(0, 2**64 - 1), max_size=20),
    st.tuples(st.integers(-1, 14), st.integers(-1, 14)),
    st.sampled_from([None, ["/even"], ["/odd", "/none"]]),
    st.data(),
)
def test_any_log_comes_in_order_of_log_time(tmp_path, times_ns, bound, topics, data):
    path = tmp_path / "log.mcap"
    written = write(path, times_ns, data.draw)
    reader = LogReader(path)
    assert list(reader) == by_time(written)
    assert list(reader.records(file_order=True)) == written
    wanted = [record for record in written if topics is None or record.topic in topics]
    inside = [record for record in wanted if bound[0] <= record.log_time_ns < bound[1]]
    assert list(reader.records(topics=topics)) == by_time(wanted)
    assert list(reader.records(topics=topics, start_ns=bound[0], end_ns=bound[1])) == by_time(inside)


@few
@given(st.lists(st.integers(0, 12), min_size=1, max_size=40), st.floats(0, 1), st.data())
def test_a_cut_off_log_gives_all_before_the_cut_in_order(tmp_path, times_ns, where, data):
    path = tmp_path / "log.mcap"
    write(path, times_ns, data.draw)
    raw = path.read_bytes()
    path.write_bytes(raw[: 8 + int(where * (len(raw) - 9))])
    reader = LogReader(path)
    before, _ = until_damage(reader.records(file_order=True))
    found, error = until_damage(reader)
    assert found == by_time(before)
    assert isinstance(error, DamagedLog)
    assert error.last_time_ns == (found[-1].log_time_ns if found else None)


def test_chunks_that_stand_in_another_order(tmp_path):
    messages = [message(k, 10 * k) for k in range(30)]
    chunks = [chunk(messages[k : k + 5], declared=CHANNELS) for k in range(0, 30, 5)]
    path = put(tmp_path / "log.mcap", *(chunks[k] for k in (3, 0, 5, 1, 4, 2)))
    assert list(LogReader(path)) == stamped(messages)


def test_messages_beside_the_chunks_come_at_their_times(tmp_path):
    messages = [message(k, 10 * k) for k in range(20)]
    late, early, beside = messages[12:], messages[:6], messages[6:12]
    path = put(tmp_path / "log.mcap", chunk(late, declared=CHANNELS), packed(*beside[::-1]), chunk(early))
    assert list(LogReader(path)) == stamped(messages)


def test_a_channel_may_be_declared_in_a_chunk_of_later_times(tmp_path):
    messages = [message(k, 10 * k) for k in range(20)]
    path = put(tmp_path / "log.mcap", chunk(messages[10:], declared=CHANNELS), chunk(messages[:10]))
    assert list(LogReader(path)) == stamped(messages)


def test_messages_of_one_time_come_as_they_stand(tmp_path):
    """Of the time 5 there are some at the end of a chunk, and at the beginning of an earlier one."""
    first = [message(k, time_ns) for k, time_ns in enumerate([5, 5, 9, 5])]
    second = [message(4 + k, time_ns) for k, time_ns in enumerate([1, 5, 5])]
    path = put(tmp_path / "log.mcap", chunk(first, declared=CHANNELS), chunk(second))
    assert [record.sequence for record in LogReader(path)] == [4, 0, 1, 3, 5, 6, 2]


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("order", ["rising", "falling", "one late"])
def test_a_large_chunk_is_put_in_order(tmp_path, order, indexed):
    times = {"rising": range(3000), "falling": range(3000, 0, -1), "one late": [*range(2999), 0]}[order]
    messages = [message(k, time_ns, 100) for k, time_ns in enumerate(times)]
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2**24, index_types=IndexType.ALL if indexed else IndexType.NONE)
        writer.start(profile="", library="other")
        for each in CHANNELS:
            writer.register_channel(each.topic, "x", 0)
        for each in messages:
            writer.add_message(each.channel_id, each.log_time, each.data, 0, each.sequence)
        writer.finish()
    assert list(LogReader(path)) == by_time(stamped(messages))


def test_an_index_that_states_a_wrong_order_is_one_line(tmp_path):
    messages = [message(k, 9000 - k, 100) for k in range(3000)]
    index = MessageIndex(1, [(k, 131 * k) for k in range(3000)])
    path = put(tmp_path / "log.mcap", chunk(messages, declared=CHANNELS), packed(index))
    with pytest.raises(LogError, match=r"log.mcap: expected log times as the chunks and their indexes state them"):
        list(LogReader(path))
    recover(path, tmp_path / "right.mcap")
    assert list(LogReader(tmp_path / "right.mcap")) == by_time(stamped(messages))


def test_chunks_that_state_wrong_times_are_one_line(tmp_path):
    """Their heads follow one another, and their messages do not."""
    messages = [message(k, 10 * k) for k in range(20)]
    late = chunk(messages[10:], declared=CHANNELS, stated=[0, 9])
    path = put(tmp_path / "log.mcap", late, chunk(messages[:10], stated=[10, 19]))
    with pytest.raises(LogError, match=r"the order of the messages cannot be determined; `reenact recover` writes"):
        list(LogReader(path))
    recover(path, tmp_path / "right.mcap")
    assert list(LogReader(tmp_path / "right.mcap")) == stamped(messages)


def test_heads_that_state_too_much_or_nothing_do_no_harm(tmp_path):
    messages = [message(k, 10 * k) for k in range(20)]
    late, early = (chunk(part, declared=CHANNELS, stated=[0, 0]) for part in (messages[10:], messages[:10]))
    wide = chunk(messages[:10], declared=CHANNELS, stated=[0, 2**63])
    for parts in ((late, early), (early, late), (late, wide), (wide, late)):
        assert list(LogReader(put(tmp_path / "log.mcap", *parts))) == stamped(messages)


def test_behind_damage_nothing_is_believed_and_all_before_it_is_in_order(tmp_path):
    messages = [message(k, 10 * k) for k in range(30)]
    damaged = bytearray(chunk(messages[:10]))
    damaged[-20] ^= 1
    parts = chunk(messages[20:], declared=CHANNELS), chunk(messages[10:20]), bytes(damaged), chunk(messages[5:8])
    found, error = until_damage(LogReader(put(tmp_path / "log.mcap", *parts)))
    assert found == stamped(messages[10:])
    assert "the CRC of a chunk does not hold; the last good message is of 0.000000290 s" in str(error)


def test_a_large_message_beside_the_chunks_comes_at_its_time(tmp_path):
    messages = [message(k, 10 * k) for k in range(10)] + [message(10, 45, 2**25)]
    path = put(
        tmp_path / "log.mcap", chunk(messages[5:10], declared=CHANNELS), packed(messages[10]), chunk(messages[:5])
    )
    assert list(LogReader(path)) == by_time(stamped(messages))


def test_a_log_of_ours_goes_by_the_order_of_the_file(tmp_path):
    """Its clock was set back; what came later is later."""
    ours = tmp_path / "ours.mcap"
    times_ns = [*range(0, 1000, 10), *range(500, 1500, 10)]
    with LogWriter(ours, manifest={}) as log:
        for time_ns in times_ns:
            log.write("/x", b"data", log_time_ns=time_ns, type_name=PoseStamped.TYPE)
    assert [record.log_time_ns for record in LogReader(ours)] == times_ns
    inside = [time_ns for time_ns in times_ns if 30 <= time_ns < 900]
    assert [record.log_time_ns for record in LogReader(ours).records(start_ns=30, end_ns=900)] == inside
    recover(ours, tmp_path / "again.mcap")
    assert [record.log_time_ns for record in LogReader(tmp_path / "again.mcap")] == times_ns
    ours.write_bytes(ours.read_bytes()[:-50])
    found, _ = until_damage(LogReader(ours))
    assert [record.log_time_ns for record in found] == times_ns


def indexed(path, messages, size):
    """Write a log whose chunks of some messages each have an index in the summary."""
    raw, indexes = bytearray(MAGIC + packed(HEADER)), []
    for place in range(0, len(messages), size):
        part = messages[place : place + size]
        times, begin = [m.log_time for m in part], len(raw)
        raw += chunk(part, declared=CHANNELS)
        length = len(packed(*CHANNELS, *part))
        indexes.append(ChunkIndex(len(raw) - begin, begin, "", length, max(times), 0, {}, min(times), length))
    raw += packed(DataEnd(zlib.crc32(raw)))
    counts = {k: sum(m.channel_id == k for m in messages) for k in (1, 2)}
    times = [m.log_time for m in messages]
    statistics = Statistics(0, 2, counts, len(indexes), len(messages), max(times), min(times), 0, 0)
    summary = packed(*CHANNELS, statistics, *indexes)
    head = packed(Footer(len(raw), 0, 0))[:-4]
    path.write_bytes(raw + summary + head + struct.pack("<I", zlib.crc32(summary + head)) + MAGIC)
    return path


def test_memory_grows_with_what_overlaps_and_not_with_the_log(tmp_path):
    """Each chunk of 100 kB overlaps with its neighbours."""
    times = [10 * k + (300 if k % 200 < 100 else 0) for k in range(12_000)]
    messages = [message(k, time_ns, 1000) for k, time_ns in enumerate(times)]
    path = indexed(tmp_path / "log.mcap", messages, 100)
    reached = list(accumulate((m.log_time for m in messages), max))
    assert reached != [m.log_time for m in messages]
    tracemalloc.start()
    latest = -1
    for record in LogReader(path):
        assert record.log_time_ns >= latest
        latest = record.log_time_ns
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert latest == max(times)
    assert peak < 3 << 20  # of 12 MB


def test_more_that_overlaps_than_may_be_held_is_one_line(tmp_path):
    """Some kB, in which every chunk is of 64 MiB and of all times."""
    half = [Message(1, time_ns, bytes(2**25), 0, time_ns) for time_ns in (0, 100)]
    same = chunk(half, declared=CHANNELS, squeeze=True)
    path = put(tmp_path / "log.mcap", *[same] * (MOST_HELD // 2**26 + 1))
    with pytest.raises(LogError, match=r"log.mcap: expected at most 160 MB of chunks that overlap in log") as caught:
        next(iter(LogReader(path)))
    assert "\n" not in str(caught.value)
    with suppress(StopIteration):
        assert next(LogReader(path).records(file_order=True)).log_time_ns == 0
