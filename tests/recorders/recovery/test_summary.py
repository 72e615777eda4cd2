"""What a log holds is said rightly: topics, rates, gaps, sessions, and whether it is sound."""

import itertools
import json
import os
import statistics
from fractions import Fraction

import pytest
from every_record import write_every_record
from every_variant import Data, Variant
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Channel, Message
from mcap.writer import Writer

from recorders.cdr.codec import encode
from recorders.errors import LogError
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.records import MAGIC
from recorders.messages.message_types import JointState, String
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT, Phase
from recorders.messages.topics import JOINT_STATES, LEFT_TARGET, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.recovery.intervals import Intervals
from recorders.recovery.log_info import summarise
from recorders.recovery.survey import CUT_OFF
from recorders.writing.writer import LogWriter

TICK_NS = 50_000_000
CHUNK = b"\x03\0\0\0lz4"
"""How the data of a chunk begin, after its length."""


def written(path, sequences, *, stamps=None, log_times=None):
    """Write joint states with these numbers; stamps and log times are those of 20 Hz unless given."""
    with LogWriter(path, manifest={"kind": "test"}) as log:
        for place, sequence in enumerate(sequences):
            stamp = stamps[place] if stamps else place * TICK_NS
            message = JointState(stamp, ("a",), [0.5])
            log_time_ns = log_times[place] if log_times else place * TICK_NS
            log.write(JOINT_STATES, message, log_time_ns=log_time_ns, sequence=sequence)
    return path


def numbers_of(path):
    (topic,) = summarise(path).topics.values()
    return topic.numbers


def test_a_sound_log(log):
    summary = summarise(log)
    said = summary.to_dict()
    assert summary.sound
    assert (said["messages"], said["chunks"], said["compression"]) == (280, 5, {"lz4": 5})
    assert (said["finished"], said["complete"], said["protected"], said["content_holds"]) == (True,) * 4
    assert (said["cut_off_at"], said["damage"], said["undeclared"]) == (None, [], 0)
    assert said["size"] == log.stat().st_size
    assert (said["first_ns"], said["last_ns"], said["duration_s"]) == (0, 39 * TICK_NS, 1.95)
    assert said["attachments"] == [{"name": "robot.urdf", "size": 8}]
    assert said["manifest"]["robot"] == "asimo"
    assert said["topics"][0] == {
        "topic": LEFT_TARGET,
        "type": "geometry_msgs/msg/PoseStamped",
        "encoding": "cdr",
        "count": 40,
        "first_ns": 0,
        "last_ns": 39 * TICK_NS,
        "rate_hz": 20.0,
        "stamp_rate_hz": 20.0,
        "missing": 0,
        "gaps": [],
        "restarts": 0,
        "numbered": True,
        "dropped": 0,
        "longest_gap_s": 0.05,
        "longest_gap_after_ns": 0,
        "jitter_s": 0.0,
        "log_time_falls": 0,
        "stamp_ahead_s": [0.0, 0.0],
    }
    assert json.loads(json.dumps(said, allow_nan=False)) == said


def test_gaps_are_named_and_counted(tmp_path):
    found = numbers_of(written(tmp_path / "x.mcap", [0, 1, 4, 5, 7]))
    assert (found.missing, found.gaps, found.more_gaps, found.restarts) == (3, [(1, 4), (5, 7)], 0, 0)
    found = numbers_of(written(tmp_path / "y.mcap", range(0, 40, 2)))
    assert (found.missing, len(found.gaps), found.more_gaps) == (19, 5, 14)


def test_numbers_that_begin_anew_are_no_gap(tmp_path):
    found = numbers_of(written(tmp_path / "x.mcap", [0, 1, 2, 0, 1, 2, 0, 1, 2]))
    assert (found.missing, found.restarts) == (0, 2)


def test_the_gaps_of_each_cycle_count(tmp_path):
    cycles = [[number for number in range(30) if number not in lost] for lost in ((2,), (27, 28), (2, 20))]
    found = numbers_of(written(tmp_path / "x.mcap", itertools.chain(*cycles)))
    assert (found.missing, found.gaps, found.restarts) == (5, [(1, 3), (26, 29), (1, 3), (19, 21)], 2)


@pytest.mark.parametrize(
    ("numbers", "missing", "restarts"),
    [
        ([0, 1, 2, 5, 0, 1, 2, 3, 4, 5], 2, 1),
        ([0, 1, 2, 3, 0, 1, 3], 1, 1),
        ([*range(10), *range(8), 9], 1, 1),
        (3 * [*range(5), *range(6, 12)], 3, 2),
    ],
)
def test_so_do_those_of_short_cycles(tmp_path, numbers, missing, restarts):
    found = numbers_of(written(tmp_path / "x.mcap", numbers))
    assert (found.missing, found.restarts) == (missing, restarts)


def test_series_on_one_channel_go_on_whatever_comes_on_another(tmp_path):
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        for number in range(30):
            for sequence in (5000 + number, number):
                log.write("/x", b"a", log_time_ns=number, sequence=sequence, opaque=True)
            for _ in range(20):
                log.write("/x", b"a", log_time_ns=number, opaque=True)
    found = numbers_of(path)
    assert (found.missing, found.restarts) == (0, 1)


@pytest.mark.parametrize(
    ("numbers", "restarts"),
    [
        ([1000, 0, 1001, 1, 1002, 2], 1),
        ([57, 1000, 58, 1001, 59, 1002], 0),  # a gap until 58 comes
        ([4, 4, 5, 5, 6, 6], 0),
        ([1, 2, 4, 3, 5], 0),  # one is late
    ],
)
def test_two_publishers_of_a_topic_and_messages_that_come_late_leave_no_gap(tmp_path, numbers, restarts):
    found = numbers_of(written(tmp_path / "x.mcap", numbers))
    assert (found.missing, found.gaps, found.more_gaps, found.restarts) == (0, [], 0, restarts)


def test_what_one_of_two_publishers_lost_is_counted(tmp_path):
    found = numbers_of(written(tmp_path / "x.mcap", [1000, 0, 1001, 1, 1003, 2, 1004, 5, 1005]))
    assert (found.missing, found.gaps, found.restarts) == (3, [(1001, 1003), (2, 5)], 1)


def test_rates_by_log_time_and_by_stamp_differ_in_a_replay(tmp_path):
    """Three cycles of the same stamps, recorded ten times as fast."""
    stamps = [tick * TICK_NS for _ in range(3) for tick in range(5)]
    log_times = [place * TICK_NS // 10 for place in range(15)]
    (topic,) = summarise(written(tmp_path / "x.mcap", range(15), stamps=stamps, log_times=log_times)).topics.values()
    assert (topic.rate_hz, topic.stamp_rate_hz) == (200.0, 20.0)


def test_a_burst_has_no_rate(tmp_path):
    (topic,) = summarise(written(tmp_path / "x.mcap", [0, 1, 2], log_times=[0, 1, 2])).topics.values()
    assert topic.rate_hz is None
    (topic,) = summarise(written(tmp_path / "y.mcap", [0, 1], log_times=[0, TICK_NS])).topics.values()
    assert topic.rate_hz is None
    (topic,) = summarise(written(tmp_path / "z.mcap", [0, 1, 2], log_times=[0, TICK_NS, 2 * TICK_NS])).topics.values()
    assert topic.rate_hz == 20.0


def test_samples_that_are_dropped_before_they_are_numbered_are_found_by_their_times(tmp_path):
    """3 % of a camera's frames, whose numbers a recorder gave."""
    start_ns, dropped = 2**63 - 100 * TICK_NS, {17, 40, 41}
    times = [start_ns + tick * TICK_NS for tick in range(100) if tick not in dropped]
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        for sequence, time_ns in enumerate(times):
            log.write("/camera", b"frame", log_time_ns=time_ns, sequence=sequence, opaque=True)
    (topic,) = summarise(path).topics.values()
    assert (topic.numbers.missing, topic.dropped) == (0, 3)
    assert (topic.longest_gap_ns, topic.log_times.longest_after_ns) == (3 * TICK_NS, start_ns + 39 * TICK_NS)


def test_messages_in_bursts_miss_none(tmp_path):
    """A learner's outputs: 64 at a time, and then nothing for a while."""
    times = [burst * 20 * TICK_NS + place * 2000 for burst in range(7) for place in range(64)]
    (topic,) = summarise(written(tmp_path / "x.mcap", range(len(times)), stamps=times, log_times=times)).topics.values()
    assert (topic.numbers.missing, topic.dropped, topic.log_times.jitter_ns) == (0, None, None)


@given(st.lists(st.integers(-(10**6), 10**6), min_size=30, max_size=60))
def test_jitter_is_the_deviation_of_the_usual_steps_to_the_nanosecond(noise):
    steps = [TICK_NS + each for each in noise]
    intervals = Intervals()
    for time_ns in itertools.accumulate(steps, initial=2**62):
        intervals.add(time_ns)
    assert intervals.jitter_ns == int(statistics.pstdev(map(Fraction, steps)))
    assert intervals.longest_ns == max(steps)
    assert intervals.dropped == 0


def test_events_have_neither_jitter_nor_dropped_samples(tmp_path):
    times = [TICK_NS * 2**power for power in range(25)]
    (topic,) = summarise(written(tmp_path / "x.mcap", range(25), stamps=times, log_times=times)).topics.values()
    assert (topic.dropped, topic.log_times.jitter_ns) == (None, None)


def test_numbers_that_all_topics_share_show_no_gap(tmp_path):
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        for number in range(60):
            log.write(f"/topic/{number % 3}", b"a", log_time_ns=number, sequence=number, opaque=True)
    said = summarise(path).to_dict()["topics"]
    assert [(topic["missing"], topic["gaps"], topic["numbered"]) for topic in said] == [(0, [], False)] * 3


def test_stamps_ahead_of_log_time_and_log_times_that_fall_are_said(tmp_path):
    hour_ns, times = 3600 * 10**9, [0, 2 * TICK_NS, TICK_NS]
    stamps = [time_ns + hour_ns for time_ns in times]
    (topic,) = summarise(written(tmp_path / "x.mcap", range(3), stamps=stamps, log_times=times)).topics.values()
    said = topic.to_dict()
    assert (said["stamp_ahead_s"], said["log_time_falls"], said["longest_gap_s"]) == ([3600.0, 3600.0], 1, None)


def test_one_message_has_no_rate(tmp_path):
    (topic,) = summarise(written(tmp_path / "x.mcap", [0])).topics.values()
    assert (topic.rate_hz, topic.stamp_rate_hz) == (None, None)


def test_a_log_without_messages(tmp_path):
    with LogWriter(tmp_path / "x.mcap", manifest={}):
        pass
    summary = summarise(tmp_path / "x.mcap")
    assert (summary.sound, summary.times_ns, summary.to_dict()["duration_s"]) == (True, None, None)


def test_the_sessions_of_a_log(tmp_path):
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        for epoch in range(2):
            for cycle, phase in enumerate((WASHOUT, LEARN, LEARN, EVALUATE)):
                marker = Phase(run="r1", epoch=epoch, cycle=cycle, phase=phase, log="")
                log.write(SESSION_PHASE, marker.to_message(), log_time_ns=cycle)
        log.write(SESSION_PHASE, String("no marker"), log_time_ns=9)
    cycles = {WASHOUT: 2, LEARN: 4, EVALUATE: 2}
    assert summarise(path).to_dict()["sessions"] == [{"run": "r1", "first_epoch": 0, "last_epoch": 1, "cycles": cycles}]


def test_a_cut_off_log_says_where_and_what_there_is(log):
    raw = log.read_bytes()
    log.write_bytes(raw[: len(raw) // 2])
    said = summarise(log).to_dict()
    assert (said["sound"], said["finished"], said["complete"], said["content_holds"]) == (False, False, False, None)
    assert said["damage"][-1]["reason"] == CUT_OFF
    assert said["cut_off_at"] == said["damage"][-1]["offset"]
    assert 0 < said["messages"] < 280
    assert said["protected"]


@pytest.mark.parametrize("step", [13, pytest.param(1, marks=pytest.mark.campaign)])
def test_all_readers_name_one_byte_at_which_a_log_is_cut_off(tmp_path, step):
    write_every_record(path := tmp_path / "every.mcap")
    raw = path.read_bytes()
    for size in range(len(MAGIC), len(raw), step):
        path.write_bytes(raw[:size])
        found, reader = summarise(path).cut_off_at, LogReader(path)
        for read in (lambda r: r.counts, list, lambda r: list(r.records(file_order=True))):
            with pytest.raises(DamagedLog, match=f"the log is cut off at byte {found}, before its end"):
                read(reader)


def test_a_damaged_log_shows_what_stands_behind_the_damage_too(log):
    raw = bytearray(log.read_bytes())
    second = raw.index(CHUNK, raw.index(CHUNK) + 1)
    raw[second + 500] ^= 1
    log.write_bytes(raw)
    said = summarise(log).to_dict()
    assert (said["sound"], said["messages"], said["content_holds"]) == (False, 280 - 64, False)
    assert sum(topic["missing"] for topic in said["topics"]) == 64
    assert len(said["damage"]) == 1


def test_another_programs_log_without_crcs_is_unprotected(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file, enable_crcs=False)
        writer.start()
        channel = writer.register_channel("/x", "json", writer.register_schema("T", "jsonschema", b"{}"))
        for index in range(3):
            writer.add_message(channel, index, b"{}", index)
        writer.finish()
    said = summarise(path).to_dict()
    assert (said["sound"], said["protected"], said["complete"], said["content_holds"]) == (True, False, None, None)
    assert (said["compression"], said["topics"][0]["type"], said["manifest"]) == ({"zstd": 1}, "T", {})


def test_messages_that_do_not_decode_are_counted_like_any(tmp_path):
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        log.write(JOINT_STATES, b"short", log_time_ns=1)
        log.write(JOINT_STATES, encode(JointState(2, ("a",), [0.5])), log_time_ns=2)
        log.write("/anything", b"\xff" * 20, log_time_ns=3, opaque=True)
    assert [topic.count for topic in summarise(path).topics.values()] == [2, 1]


def test_what_is_no_log_is_refused(tmp_path):
    for path, expected in ((tmp_path / "none.mcap", "no such file"), (tmp_path, "found a directory")):
        with pytest.raises(LogError, match=expected):
            summarise(path)


def test_two_channels_of_a_topic_are_numbered_apart(tmp_path):
    """Our own writer makes two where some messages come with their producer's number and others do not."""
    path = tmp_path / "x.mcap"
    with LogWriter(path, manifest={}) as log:
        for number in range(10):
            log.write("/x", b"a", log_time_ns=2 * number, sequence=5000 + 2 * number, opaque=True)
            log.write("/x", b"a", log_time_ns=2 * number + 1, opaque=True)
    (topic,) = summarise(path).topics.values()
    assert (topic.count, topic.numbers.missing, topic.numbers.gaps[0], topic.numbers.restarts) == (
        20,
        9,
        (5000, 5002),
        0,
    )


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(LogError, match=r"pipe.mcap: expected an MCAP file, found a pipe"):
        summarise(tmp_path / "pipe.mcap")


@pytest.mark.parametrize(
    ("total", "said"),
    [
        ("message_count", "4 messages, found 3"),
        ("chunk_count", "2 chunks, found 1"),
        ("attachment_count", "1 attachments, found 0"),
        ("channel_count", "2 channels, found 1"),
        ("metadata_count", "1 metadata records, found 0"),
        ("channel_message_counts", "2 messages on /x, found 3"),
    ],
)
def test_a_wrong_total_in_the_statistics_is_said(tmp_path, total, said):
    class Wrong(Variant):
        def _statistics(self, data):
            statistics = super()._statistics(data)
            if total == "channel_message_counts":
                statistics.channel_message_counts[1] -= 1
            else:
                setattr(statistics, total, getattr(statistics, total) + 1)
            return statistics

    data = Data((), [Channel(1, "/x", "json", {}, 0)], [Message(1, k, b"{}", 0, k) for k in range(3)])
    path = tmp_path / "foreign.mcap"
    Wrong({"ch", "chx", "rch", "st"}).write(path, data)
    summary = summarise(path)
    assert (summary.sound, summary.counts_hold, summary.wrong_totals) == (False, False, [said])
    assert (summary.survey.damage, summary.to_dict()["messages"]) == ([], 3)
    assert LogReader(path).counts == {"/x": 3}
