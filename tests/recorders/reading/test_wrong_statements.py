"""What a log says of itself may be wrong, its CRCs notwithstanding: nothing is lost by that, and it is said."""

import struct
import zlib

import pytest
from every_record import packed
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Message, Schema, Statistics

from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.records import MAGIC
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import recover

FIRST = "the time of the first message"
START_NS = 1_700_000_000_000_000_000
SCHEMA = Schema(1, b"string data", "ros2msg", "std_msgs/msg/String")
CHANNEL, OTHER = (Channel(1, topic, "cdr", {}, 1) for topic in ("/x", "/y"))


def messages(first, count):
    return [Message(1, START_NS + 10**9 * k, b"data", 0, k) for k in range(first, first + count)]


class Log:
    """A log under construction, with a summary that has a CRC."""

    def __init__(self, *declared):
        self.raw = bytearray(MAGIC + packed(Header("", "other"), *declared))
        self.indexes, self.messages = [], []

    def chunk(self, held, *, declared=(), times_ns=None):
        """Add a chunk, for which other times than its messages have may be stated, in its head and in the summary."""
        data, begin = packed(*declared, *held), len(self.raw)
        first_ns, last_ns = times_ns or (held[0].log_time, held[-1].log_time)
        self.raw += packed(Chunk("", data, last_ns, first_ns, zlib.crc32(data), len(data)))
        size = len(self.raw) - begin
        self.indexes.append(ChunkIndex(size, begin, "", len(data), last_ns, 0, {}, first_ns, len(data)))
        self.messages += held
        return self

    def end(self, path, *repeated, **stated):
        """Write the log; what else is stated replaces the right statistics."""
        self.raw += packed(DataEnd(zlib.crc32(self.raw)))
        times = [message.log_time for message in self.messages]
        right = {
            "attachment_count": 0,
            "channel_count": 1,
            "channel_message_counts": {1: len(times)},
            "chunk_count": len(self.indexes),
            "message_count": len(times),
            "message_end_time": max(times),
            "message_start_time": min(times),
            "metadata_count": 0,
            "schema_count": 1,
        }
        summary = packed(*(repeated or (SCHEMA, CHANNEL)), Statistics(**right | stated), *self.indexes)
        head = packed(Footer(len(self.raw), 0, 0))[:-4]
        path.write_bytes(self.raw + summary + head + struct.pack("<I", zlib.crc32(summary + head)) + MAGIC)
        return path


def played(path, **asked):
    return [record.sequence for record in LogReader(path).records(**asked)]


@pytest.mark.parametrize("unit_ns", [1000, 10**9])
def test_a_slice_holds_what_is_of_its_time_whatever_the_chunks_state(tmp_path, unit_ns):
    log = Log(SCHEMA, CHANNEL)
    for first in range(0, 50, 10):
        held = messages(first, 10)
        log.chunk(held, times_ns=(held[0].log_time // unit_ns, held[-1].log_time // unit_ns))
    path = log.end(tmp_path / "log.mcap")
    for first, end in ((0, 50), (5, 45), (10, 20), (49, 50)):
        asked = {"start_ns": START_NS + first * 10**9, "end_ns": START_NS + end * 10**9}
        for file_order in (False, True):
            assert played(path, **asked, file_order=file_order) == list(range(first, end))


def test_messages_before_their_channel_are_read_if_the_summary_has_it(tmp_path):
    path = Log().chunk(messages(0, 5)).chunk(messages(5, 5), declared=(SCHEMA, CHANNEL)).end(tmp_path / "log.mcap")
    assert summarise(path).sound
    assert played(path) == played(path, start_ns=1) == list(range(10))
    assert {record.type for record in LogReader(path)} == {SCHEMA.name}


@pytest.mark.parametrize("overlap", [False, True])
def test_a_channel_that_becomes_another_is_refused_and_recovered_as_two(tmp_path, overlap):
    log = Log(SCHEMA).chunk(messages(0, 5), declared=(CHANNEL,))
    path = log.chunk(messages(2 if overlap else 5, 5), declared=(OTHER,)).end(tmp_path / "log.mcap")
    for asked in ({}, {"start_ns": 1}, {"file_order": True}):
        with pytest.raises(DamagedLog, match=r"channel 1 is declared as /y \(.*String\), elsewhere as /x"):
            played(path, **asked)
    summary = summarise(path)
    assert not summary.sound
    assert {topic.topic: topic.count for topic in summary.topics.values()} == {"/x": 5, "/y": 5}
    recovery = recover(path, tmp_path / "out.mcap")
    assert (recovery.saved, recovery.lost) == ({"/x": 5, "/y": 5}, {})
    assert LogReader(recovery.out).counts == {"/x": 5, "/y": 5}


def test_what_cannot_be_kept_is_counted_as_lost(tmp_path):
    """No summary has their channel either."""
    path = tmp_path / "log.mcap"
    raw = MAGIC + packed(Header("", "other"), *messages(0, 3), SCHEMA, CHANNEL, *messages(3, 2))
    path.write_bytes(raw + packed(DataEnd(zlib.crc32(raw)), Footer(0, 0, 0)) + MAGIC)
    recovery = recover(path, tmp_path / "out.mcap")
    assert (recovery.saved.total(), recovery.undeclared, recovery.lost.total()) == (2, 3, 3)
    assert (recovery.exact, recovery.complete) == (True, False)


@pytest.mark.parametrize("missing", ["attachment", "metadata"])
def test_no_recovery_is_complete_without_all_attachments_and_metadata(tmp_path, missing):
    log = Log(SCHEMA, CHANNEL).chunk(messages(0, 3))
    path = log.end(tmp_path / "sound.mcap")
    assert recover(path, tmp_path / "again.mcap").complete
    log = Log(SCHEMA, CHANNEL).chunk(messages(0, 3))
    if missing == "attachment":
        log.raw += packed(Attachment(0, 0, "x", "", b"data"))[:-4] + b"\1\2\3\4"
    recovery = recover(log.end(tmp_path / "log.mcap", **{f"{missing}_count": 1}), tmp_path / "out.mcap")
    assert (recovery.saved.total(), recovery.lost.total(), recovery.complete) == (3, 0, False)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (
            {"message_start_time": START_NS + 1},
            rf"{START_NS + 1} ns as the time of the first message, found {START_NS}",
        ),
        ({"message_end_time": 7}, f"7 ns as that of the last, found {START_NS + 2 * 10**9}"),
        ({"message_start_time": 0}, f"0 ns as {FIRST}, found {START_NS}"),
        ({"message_start_time": 0, "message_end_time": 0}, ""),  # some writers state none
    ],
)
def test_wrong_times_of_first_and_last_message_are_said(tmp_path, stated, said):
    summary = summarise(Log(SCHEMA, CHANNEL).chunk(messages(0, 3)).end(tmp_path / "log.mcap", **stated))
    assert summary.wrong_totals == ([said] if said else [])
    assert summary.sound is not bool(said)
