"""Gaps and messages that are no samples change nothing of the ticks beside them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from tracked_arm import MS, START, aligned, joints, pose, steady

from pipeline.alignment.blocks import Dropped
from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import JointState
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE


def test_nothing_is_extrapolated_and_a_gap_cuts_the_episode():
    records = [r for r in steady() if not (r.topic == "/tracker" and 300 * MS < r.log_time_ns - START < 600 * MS)]
    aligner, found = aligned(records, period=20 * MS, tolerance_ns=50 * MS)
    stamps = [(record.log_time_ns - START) // MS for record in found[::2]]
    assert stamps == [*range(0, 301, 20), *range(600, 991, 20)]
    numbers = [record.sequence for record in found[::2]]
    assert [b - a for a, b in pairwise(numbers)].count(2) == 1
    assert aligner.missed == 14


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (pose(START + 405 * MS, (0, 0, 0), (0, 0, 0, 0)), Dropped.NO_LENGTH),
        (pose(START + 405 * MS, (math.nan, 0, 0)), Dropped.NOT_FINITE),
        (pose(0, (0, 0, 0)), Dropped.NO_STAMP),
        (pose(START, (0, 0, 0))._replace(data=b"\x00\x01\x00\x00cut"), Dropped.UNREADABLE),
        (joints(START + 405 * MS, (0.0, math.inf)), Dropped.NOT_FINITE),
        (joints(START + 405 * MS, (0.0, 1.0), ("finger", "elbow")), Dropped.JOINTS_MISSING),
        (joints(START + 405 * MS, (), ()), Dropped.JOINTS_MISSING),
    ],
    ids=lambda value: value.name if isinstance(value, Dropped) else "",
)
def test_a_message_that_is_no_sample_is_counted_and_changes_nothing(bad, reason):
    records = steady()
    _, expected = aligned(records)
    aligner, found = aligned([*records[:82], bad, *records[82:]])
    assert found == expected
    assert sum((counts.dropped for counts in aligner.counts), start=type(aligner.counts[0].dropped)()) == {reason: 1}


def test_other_joints_and_other_layouts_are_no_matter():
    """Fingers, NaN in velocities, another order, the other byte order: the robot's joints are found by name."""
    plain = steady()
    _, expected = aligned(plain)
    other = []
    for index, record in enumerate(plain):
        message = decode(record.type, record.data)
        if isinstance(message, JointState) and index % 3:
            names, values = ("finger", "elbow", "shoulder"), np.array([math.nan, *message.position[::-1]])
            message = JointState(message.stamp_ns, names, np.nan_to_num(values, nan=0.5), velocity=values * math.nan)
            record = record._replace(data=encode(message))
        other.append(record)
    assert aligned(other)[1] == expected


@pytest.mark.parametrize("period", [None, 10 * MS])
@pytest.mark.parametrize(
    ("tolerance_ms", "pause_ns", "cut"),
    [(20, 10**9, False), (20, 10**9 + 1, True), (200, 2 * 10**9, False), (200, 2 * 10**9 + 1, True)],
)
def test_a_pause_cuts_after_a_second_and_ten_tolerances(period, tolerance_ms, pause_ns, cut):
    """Ticks of a topic, that is; at a rate every tick that is missing cuts."""
    stamps = [START, START + 10 * MS, START + 10 * MS + pause_ns, START + 20 * MS + pause_ns]
    records = [record for stamp in stamps for record in (joints(stamp, (0.0, 0.0)), pose(stamp, (0.0, 0.0, 0.0)))]
    aligner, found = aligned(records, period=period, tolerance_ns=tolerance_ms * MS)
    numbers = [record.sequence for record in found[::2]]
    assert numbers[:2] == [0, 1]
    assert numbers[2] == (3 if cut or period else 2)
    assert aligner.missed == (0 if period is None else pause_ns // (10 * MS) - 1 + (pause_ns % (10 * MS) > 0))


@pytest.mark.parametrize("block", [1, 3, 8192])
def test_the_messages_of_a_topic_are_counted_by_what_became_of_them(block):
    """First and last times are of what was used, or may yet be; frames are those of all, in order of arrival."""
    records = [
        pose(START - 9 * MS, (0, 0, 0), (0, 0, 0, 0)),
        pose(START - 8 * MS, (0, 0, 0), frame="elsewhere"),
        pose(START + 1 * MS, (0, 0, 0), frame="/world"),
        pose(START + 1 * MS, (0, 0, 0)),
        pose(START + 100 * 10**9, (0, 0, 0)),
        pose(START + 4 * MS, (0, 0, 0)),
        pose(START + 5 * MS, (math.nan, 0, 0)),
        pose(0, (0, 0, 0), frame="last"),
        pose(1, (0, 0, 0))._replace(data=b"\0\1\0\0"),
    ]
    counts = aligned(records, block=block)[0].counts[0]
    reasons = (Dropped.NO_LENGTH, Dropped.UNKNOWN_FRAME, Dropped.LATE, Dropped.AHEAD, Dropped.NOT_FINITE)
    assert counts.dropped == dict.fromkeys((*reasons, Dropped.NO_STAMP, Dropped.UNREADABLE), 1)
    assert (counts.used, counts.first_ns, counts.last_ns) == (2, START + 1 * MS, START + 4 * MS)
    assert [*counts.frames] == ["world", "elsewhere", "/world", "last"]
    assert counts.first_error.startswith("geometry_msgs/msg/PoseStamped: ")


def test_a_topic_may_begin_far_ahead():
    aligner, _ = aligned([joints(START, (0.0, 0.0)), pose(START + 100 * 10**9, (0, 0, 0))])
    assert (aligner.counts[0].used, aligner.counts[0].first_ns) == (0, START + 100 * 10**9)
    assert aligner.counts[0].last_ns is None


def test_frames_from_anyone_are_named_a_hundred_of_a_topic_at_most():
    records = [pose(START + index * MS, (0, 0, 0), frame=f"f{index}") for index in range(150)]
    counts = aligned(records)[0].counts[0]
    assert counts.dropped == {Dropped.UNKNOWN_FRAME: 150}
    assert 90 < len(counts.frames) < 110
    assert [*counts.frames] == [f"f{index}" for index in range(len(counts.frames))]


def test_messages_of_the_sources_of_frames_and_of_phases_are_wanted():
    assert aligned([])[0].topics == {"/tracker", "/joint_states", "/tf_static", "/session/phase"}


@pytest.mark.parametrize("clock", ["header", "log"])
def test_the_earliest_stamp_is_a_nanosecond(clock):
    aligner, _ = aligned([pose(0, (0, 0, 0)), pose(1, (0, 0, 0))], clock=clock)
    reason = Dropped.NO_STAMP if clock == "header" else Dropped.NO_LOG_TIME
    assert (aligner.counts[0].used, aligner.counts[0].dropped) == (1, {reason: 1})


def test_frames_of_joints_are_noted_too():
    records = [joints(START + index, (0.0, 0.0)) for index in range(2)]
    framed = [
        record._replace(
            data=encode(JointState(START + index, ("shoulder", "elbow"), np.zeros(2), frame_id=f"f{index}"))
        )
        for index, record in enumerate(records)
    ]
    counts = aligned(framed)[0].counts[1]
    assert ([*counts.frames], counts.used) == (["f0", "f1"], 2)


@pytest.mark.parametrize("block", [1, 8192])
@pytest.mark.parametrize(("ahead_ns", "made"), [(10**10, 3), (10**10 + 1, 2)])
def test_a_tick_is_given_up_when_a_topic_is_more_than_ten_seconds_ahead(block, ahead_ns, made):
    late, ahead = START + 5 * 10**9, START + 5 * 10**9 + ahead_ns
    before = [pose(START, (0, 0, 0)), joints(START, (0.0, 0.0)), joints(late, (0.0, 0.0)), joints(ahead, (0.0, 0.0))]
    aligner, found = aligned([*before, pose(late, (0, 0, 0)), pose(ahead, (0, 0, 0))], block=block)
    assert [record.log_time_ns for record in found[::2]] == [START, *([late] if made == 3 else []), ahead]
    assert (aligner.made, aligner.missed) == (made, 3 - made)


def test_a_cycle_after_one_of_a_single_tick_begins_with_a_cut():
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    marker = RecordedMessage(SESSION_PHASE, message.TYPE, encode(message), 0, START)
    aligner, found = aligned([*steady(1), marker, *steady(3)[2:]])
    assert [record.sequence for record in found[::2]] == [0, 2, 3]
    assert (aligner.made, aligner.missed) == (3, 0)


def test_one_tick_that_is_missing_at_a_rate_cuts():
    records = [record for place, record in enumerate(steady(9)) if place not in (8, 9)]
    aligner, found = aligned(records, period=10 * MS, tolerance_ns=MS)
    assert [record.sequence for record in found[::2]] == [0, 1, 2, 3, 5, 6, 7, 8]
    assert (aligner.made, aligner.missed) == (8, 1)
