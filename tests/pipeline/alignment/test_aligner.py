"""Ticks are those of a plain version that goes message by message, and the same bits in whatever blocks they come."""

import hashlib
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_alignment import align
from plain_synchronizer import ApproximateTimeSynchronizer, TimeSynchronizer

from pipeline.alignment import frames
from pipeline.alignment.blocks import Dropped, joints_kind, pose_kind
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import TF_STATIC, StaticFrames
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.ticks import Aligner, Source
from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import JointState, PoseStamped, TFMessage, TransformStamped
from recorders.messages.record import RecordedMessage

MS = 10**6
START = 1_700_000_000 * 10**9
JOINTS = ("shoulder", "elbow")
SOURCES = (
    Source("/tracker", "/hand/right/measured", pose_kind()),
    Source("/joint_states", "/sample/joint_states", joints_kind(JOINTS)),
)


def joints(stamp, values, names=JOINTS, log_time=None):
    message = JointState(stamp, names, np.array(values, dtype=float))
    return RecordedMessage("/joint_states", message.TYPE, encode(message), 0, stamp if log_time is None else log_time)


def pose(stamp, position, orientation=(0.0, 0.0, 0.0, 1.0), frame="world"):
    message = PoseStamped(stamp, np.array(position), orientation=np.array(orientation), frame_id=frame)
    return RecordedMessage("/tracker", message.TYPE, encode(message), 0, stamp)


def aligned(records, *, block=8192, period=None, sources=SOURCES, own=(), pivot=0, **config):
    aligner = Aligner(
        sources, AlignmentConfig(**config), period_ns=period, pivot=pivot, frames=StaticFrames(["", "world", *own])
    )
    made, rows = [], RowFormat(sources, JOINTS)
    for start in range(0, len(records), block):
        made += [rows.rows(ticks) for ticks in aligner.feed(records[start : start + block])]
    return aligner, list(rows.records(b"".join(made)))


@st.composite
def logs(draw):
    """Messages of a tracker and of joints, in order of arrival: lost, late, repeated and out of step."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count, rates = draw(st.integers(2, 60)), (draw(st.integers(1, 60)), draw(st.integers(1, 60)))
    messages, times = [], [START, START + draw(st.integers(-100, 100)) * MS]
    for _ in range(count):
        topic = int(rng.integers(2))
        step = int(rng.integers(-2, 2 * rates[topic])) * MS + int(rng.choice([0, 0, 1, 333_333]))
        hole = int(rng.choice([0] * 20 + [500 * MS, 2 * 10**9, 12 * 10**9]))
        times[topic] += step + hole
        if topic:
            messages.append(("/joint_states", times[1], rng.uniform(-1, 1, 2).tolist(), False))
        else:
            turn = rng.normal(size=4)
            turn /= math.sqrt((turn**2).sum())
            messages.append(("/tracker", times[0], [*rng.uniform(-1, 1, 3).tolist(), *turn.tolist()], True))
    return messages


@st.composite
def stalled_logs(draw):
    """Messages of which those of one topic are held up for more than ten seconds, and then come all at once."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    period = draw(st.sampled_from([250, 400, 900])) * MS
    stalled, first, count = draw(st.sampled_from(["/tracker", "/joint_states"])), draw(st.integers(0, 20)), 80
    messages = []
    for index in range(count):
        stamp = START + index * period
        messages.append(("/joint_states", stamp, rng.uniform(-1, 1, 2).tolist(), False))
        messages.append(("/tracker", stamp, [*rng.uniform(-1, 1, 3).tolist(), 0.0, 0.0, 0.0, 1.0], True))
    last = first + 10**10 // period + draw(st.integers(1, 10))
    part = messages[2 * first : 2 * last]
    return [
        *messages[: 2 * first],
        *(message for message in part if message[0] != stalled),
        *(message for message in part if message[0] == stalled),
        *messages[2 * last :],
    ]


CASES = given(
    logs() | stalled_logs(),
    st.sampled_from([0, 5, 20, 100, 1000]),
    st.sampled_from([None, 10, 33, 100]),
    st.sampled_from([0, 1]),
    st.sampled_from([1, 3, 7]),
)


@settings(max_examples=30, deadline=None)
@given(stalled_logs(), st.sampled_from([5, 100]), st.sampled_from([None, 100]), st.sampled_from([0, 1]), st.just(1))
def test_ticks_of_stalled_topics_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


@settings(max_examples=100, deadline=None)
@CASES
def test_ticks_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


@pytest.mark.campaign
@settings(max_examples=1000, deadline=None)
@CASES
def test_ticks_of_a_thousand_logs_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


def check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    period, tolerance = None if period_ms is None else period_ms * MS, tolerance_ms * MS
    expected = align(messages, ["/tracker", "/joint_states"], tolerance=tolerance, period=period, pivot=pivot)
    records = [
        pose(stamp, values[:3], values[3:]) if turns else joints(stamp, values) for _, stamp, values, turns in messages
    ]
    options = {"period": period, "pivot": pivot, "tolerance_ns": tolerance}
    aligner, found = aligned(records, **options)
    again, others = aligned(records, block=block, **options)
    assert others == found
    assert (again.made, again.missed) == (aligner.made, aligner.missed)
    assert aligner.made == len(expected) == len(found) // 2
    number = -1
    for (stamp, values, cut), hand, posture in zip(expected, found[::2], found[1::2], strict=True):
        number += 2 if cut else 1
        assert (hand.topic, posture.topic) == ("/hand/right/measured", "/sample/joint_states")
        assert (hand.sequence, hand.log_time_ns, posture.sequence, posture.log_time_ns) == (number, stamp) * 2
        there, moved = decode(hand.type, hand.data), decode(posture.type, posture.data)
        assert (there.stamp_ns, moved.stamp_ns, moved.name) == (stamp, stamp, JOINTS)
        assert moved.position.tolist() == values["/joint_states"]
        assert there.position.tolist() == values["/tracker"][:3]
        np.testing.assert_allclose(there.orientation, values["/tracker"][3:], rtol=0, atol=2e-15)


@pytest.mark.parametrize("block", [1, 8192])
def test_a_tick_that_came_too_late_is_missed_and_cuts(block):
    """Poses stop at 8.9 s, joints run on to 19.05 s, and then poses come from 9.0 s on."""
    moving = [joints(START + index * 50 * MS, (0.01 * index, 0.0)) for index in range(382)]
    hands = [pose(START + index * 100 * MS, (0.001 * index, 0.0, 0.0)) for index in range(191)]
    records = sorted([*moving[:179], *hands[:90]], key=lambda record: record.log_time_ns)
    aligner, found = aligned([*records, *moving[179:], *hands[90:]], block=block)
    stamps = [(record.log_time_ns - START) // MS for record in found[::2]]
    assert stamps == [*range(0, 8901, 100), *range(9100, 19001, 100)]
    assert (aligner.made, aligner.missed) == (190, 1)
    assert [record.sequence for record in found[::2]] == [*range(90), *range(91, 191)]


@pytest.mark.parametrize("block", [1, 7, 8192])
@pytest.mark.parametrize("ahead_s", [61, 300_000_000])
def test_a_lone_stamp_far_ahead_is_dropped_and_changes_nothing(block, ahead_s):
    records = steady(999)
    _, expected = aligned(records)
    odd = [joints(START + ahead_s * 10**9 + index, (0.5, 0.5)) for index in range(2)]
    aligner, found = aligned([*records[:200], *odd, *records[200:]], block=block)
    assert found == expected
    assert [counts.dropped for counts in aligner.counts] == [{}, {Dropped.AHEAD: 2}]


@pytest.mark.parametrize("block", [1, 7, 8192])
def test_a_long_pause_costs_two_messages_of_a_topic(block):
    """The third that goes on there is taken, and what follows with it."""
    later = [shifted(record, 10**6 * 10**9) for record in steady(50)]
    aligner, found = aligned([*steady(50), *later], block=block)
    assert (aligner.made, aligner.missed, aligner.restarts) == (98, 0, 0)
    assert [counts.dropped for counts in aligner.counts] == [{Dropped.AHEAD: 2}] * 2
    assert [after.sequence - before.sequence for before, after in pairwise(found[::2])].count(2) == 1


@pytest.mark.parametrize("block", [1, 7, 8192])
@pytest.mark.parametrize("first", ["steady", "three far ahead"])
def test_a_clock_that_begins_anew_is_followed(block, first):
    """A simulator is reset, or some stamps of one topic were of another clock."""
    before = steady(50) if first == "steady" else [joints(START + 4 * 10**17 + i, (0.0, 0.0)) for i in range(3)]
    after = [shifted(record, -1000 * 10**9) for record in steady(100)]
    aligner, found = aligned([*before, *after], block=block)
    assert aligner.restarts == 1
    anew = [record.log_time_ns - START + 1000 * 10**9 for record in found[::2] if record.log_time_ns < START]
    assert anew == [index * 10 * MS for index in range(10, 100)]
    assert aligner.made == len(anew) + (50 if first == "steady" else 0)


def test_a_clock_that_begins_anew_all_the_time_is_followed_in_one_block():
    """Hundreds of times in one block, as one by one."""
    records = [
        joints(START - turn * 100 * 10**9 + index * 10 * MS, (0.0, 0.0)) for turn in range(300) for index in range(20)
    ]
    aligner, found = aligned(records, sources=SOURCES[1:], period=10 * MS)
    assert aligner.restarts == 299
    assert found == aligned(records, sources=SOURCES[1:], period=10 * MS, block=1)[1]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["joints", "tracker", "both"]),
            st.sampled_from([0, 0, 0, -5, 5, 30, 100, -100, 10**6, -(10**6)]),
            st.integers(1, 25),
        ),
        max_size=12,
    ),
    st.sampled_from([None, 100]),
    st.sampled_from([2, 7]),
)
def test_odd_clocks_are_the_same_in_whatever_blocks(parts, period_ms, block):
    """Messages of one topic or both, on clocks that leap ahead and back [s], for some messages each."""
    records, now = [], START
    for topics, leap_s, count in parts:
        for index in range(count):
            stamp = now + leap_s * 10**9 + index * 50 * MS
            records += [joints(stamp, (0.1 * index, 0.0))] if topics != "tracker" else []
            records += [pose(stamp + 1, (0.1 * index, 0.0, 0.0))] if topics != "joints" else []
        now += count * 50 * MS
    options = {"period": None if period_ms is None else period_ms * MS}
    one, by_one = aligned(records, block=1, **options)
    for size in (block, 8192):
        aligner, found = aligned(records, block=size, **options)
        assert found == by_one
        assert (aligner.made, aligner.missed, aligner.restarts) == (one.made, one.missed, one.restarts)
        assert [counts.dropped for counts in aligner.counts] == [counts.dropped for counts in one.counts]


def shifted(record, by_ns):
    """Return a message whose stamp is shifted [ns]."""
    message = decode(record.type, record.data)
    return record._replace(data=encode(replace(message, stamp_ns=message.stamp_ns + by_ns)))


@pytest.mark.parametrize(
    ("records", "config"),
    [
        ([pose(5 * 10**9, (0, 0, 0))], {"latencies_ns": {"/tracker": 6 * 10**9}}),
        ([pose(2**31 * 10**9 - 1, (0, 0, 0))], {"latencies_ns": {"/tracker": -1}}),
        ([pose(1, (0, 0, 0))._replace(log_time_ns=2**32 * 10**9)], {"clock": "log"}),
    ],
)
def test_a_time_that_no_message_can_have_is_dropped(records, config):
    aligner, found = aligned(records, **config)
    assert found == []
    assert aligner.counts[0].dropped == {Dropped.OUT_OF_RANGE: 1}


def test_what_was_recorded_at_time_0_has_no_time_on_the_log_clock():
    aligner, _ = aligned([pose(START, (0, 0, 0))._replace(log_time_ns=0)], clock="log")
    assert aligner.counts[0].dropped == {Dropped.NO_LOG_TIME: 1}


def test_bits_are_these():
    """Every operation is one that IEEE 754 fixes, in an order that is fixed here."""
    rng = np.random.default_rng(3)
    records = []
    for index in range(600):
        records.append(joints(START + index * 7 * MS, rng.uniform(-2, 2, 2)))
        if index % 3 == 0:
            records.append(pose(START + index * 7 * MS + 12_345, rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 4)))
    _, found = aligned(records, period=33_333_333)
    digest = hashlib.sha256(b"".join(record.data for record in found)).hexdigest()
    assert (len(found), digest[:16]) == (250, "775dca4bb44f4c2e")


@st.composite
def arrivals(draw):
    """Stamps of a tracker and of joints [ms], rising for each, many of them shared; and the order of arrival."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    share, skew = draw(st.sampled_from([0.1, 0.5, 0.9, 1.0])), draw(st.integers(0, 200))
    messages = []
    for topic in ("/tracker", "/joint_states"):
        stamps = np.flatnonzero(rng.random(draw(st.integers(1, 120))) < share) + 1
        delays = np.maximum.accumulate(stamps + rng.integers(0, skew + 1, len(stamps)))  # none overtakes its own topic
        messages += [(int(at), topic, int(stamp)) for at, stamp in zip(delays, stamps, strict=True)]
    return [(topic, stamp) for _, topic, stamp in sorted(messages, key=lambda message: message[0])]


@settings(max_examples=60, deadline=None)
@given(arrivals(), st.sampled_from([1, 3, 8192]))
def test_messages_of_one_stamp_are_the_ticks_of_a_synchronizer(messages, block):
    check_against_synchronizers(messages, block)


@pytest.mark.campaign
@settings(max_examples=1000, deadline=None)
@given(arrivals(), st.sampled_from([1, 3, 8192]))
def test_messages_of_one_stamp_of_a_thousand_logs_are_the_ticks_of_a_synchronizer(messages, block):
    check_against_synchronizers(messages, block)


def check_against_synchronizers(messages, block):
    """Where stamps are equal, ticks are what message_filters' synchronizers call back with, to the bit."""
    exact, close = [], []
    synchronizers = (
        TimeSynchronizer(["/tracker", "/joint_states"], 1000, lambda *found: exact.append(found)),
        ApproximateTimeSynchronizer(["/tracker", "/joint_states"], 1000, 1, lambda *found: close.append(found)),
    )
    records = []
    for topic, t in messages:
        stamp = START + t * MS
        records.append(pose(stamp, (t, -0.0, 0.1)) if topic == "/tracker" else joints(stamp, (t, -0.0)))
        for synchronizer in synchronizers:
            synchronizer.add(topic, stamp, records[-1])
    _, found = aligned(records, tolerance_ns=0, block=block)
    assert exact == close
    assert [record.log_time_ns for record in found[::2]] == [tracked.log_time_ns for tracked, _ in exact]
    for taken, ticked in zip(exact, zip(found[::2], found[1::2], strict=True), strict=True):
        expected = [decode(message.type, message.data).position.tobytes() for message in taken]
        assert [decode(message.type, message.data).position.tobytes() for message in ticked] == expected


def steady(count=100, **changes):
    """Return 100 Hz of joints and of a tracker, both moving."""
    return [
        record
        for index in range(count)
        for record in (
            joints(START + index * 10 * MS, (0.01 * index, 0.0)),
            pose(START + index * 10 * MS, (0.001 * index, 0.0, 0.0), **changes),
        )
    ]


def test_nothing_is_extrapolated_and_a_gap_cuts_the_episode():
    records = [r for r in steady() if not (r.topic == "/tracker" and 300 * MS < r.log_time_ns - START < 600 * MS)]
    aligner, found = aligned(records, period=20 * MS, tolerance_ns=50 * MS)
    stamps = [(record.log_time_ns - START) // MS for record in found[::2]]
    assert stamps == [*range(0, 301, 20), *range(600, 991, 20)]
    numbers = [record.sequence for record in found[::2]]
    assert [b - a for a, b in pairwise(numbers)].count(2) == 1
    assert aligner.missed == 14


def test_what_comes_late_is_counted_and_changes_nothing():
    records = steady()
    _, expected = aligned(records)
    late = [*records[:50], *records[10:20], *records[50:]]
    aligner, found = aligned(late)
    assert found == expected
    assert [counts.dropped[Dropped.LATE] for counts in aligner.counts] == [5, 5]


def test_a_silent_topic_holds_up_no_more_than_a_while():
    """What waits is bounded: after ten seconds of one topic without the other, its ticks are given up."""
    records = [joints(START + index * 10 * MS, (0.0, 0.0)) for index in range(5000)]
    aligner, _ = aligned([pose(START, (0, 0, 0)), *records], block=100, period=10 * MS, pivot=1)
    assert len(aligner._tracks[1].stamps_ns) < 1100
    _, found = aligned([*records, *[pose(START + t * 10 * MS, (t, 0, 0)) for t in range(5000)]], pivot=1)
    assert {record.log_time_ns >= START + 3999 * 10 * MS for record in found} == {True}


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


def test_latency_shifts_stamps_and_the_log_clock_replaces_them():
    records = [r._replace(log_time_ns=r.log_time_ns + 3 * MS) for r in steady()]
    _, found = aligned(records, latencies_ns={"/tracker": 5 * MS, "/joint_states": -MS}, period=10 * MS)
    at = {r.log_time_ns: decode(r.type, r.data).position for r in found[::2]}
    np.testing.assert_allclose(at[START + 200 * MS][0], 0.0205, rtol=0, atol=1e-12)
    unstamped = [joints(0, (0.01 * i, 0.0), log_time=START + i * 10 * MS) for i in range(100)]
    unstamped = [r for pair in zip(unstamped, steady()[1::2], strict=True) for r in pair]
    aligner, found = aligned(unstamped, clock="log")
    assert aligner.made == 100


def test_frames_turn_poses_into_the_world():
    half = math.sqrt(0.5)
    quarter_about_z = (1.0, 2.0, 3.0, 0.0, 0.0, half, half)
    _, found = aligned(steady(frame="camera"), own=["camera"])
    options = AlignmentConfig(frames={"/tracker": quarter_about_z})
    aligner = Aligner(SOURCES, options, frames=StaticFrames(["world"]))
    rows = RowFormat(SOURCES, JOINTS)
    turned = [r for ticks in aligner.feed(steady(frame="camera")) for r in rows.records(rows.rows(ticks))]
    for here, there in zip(found[::2], turned[::2], strict=True):
        x, y, z = decode(here.type, here.data).position
        message = decode(there.type, there.data)
        np.testing.assert_allclose(message.position, (1.0 - y, 2.0 + x, 3.0 + z), atol=1e-15)
        np.testing.assert_allclose(message.orientation, (0.0, 0.0, half, half), atol=1e-15)


@pytest.mark.parametrize("upwards", [True, False])
def test_frames_that_stand_still_in_the_robots_are_honoured(upwards):
    """Whether the camera hangs on the robot or the robot stands in the map."""
    half = math.sqrt(0.5)
    down = TransformStamped(0, "world", "mount", np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, half, half]))
    up = TransformStamped(0, "mount", "world", np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, -half, half]))
    lens = TransformStamped(0, "mount", "camera", np.array([0.5, 0.0, 0.0]))
    transforms = TFMessage((lens, down)) if upwards else TFMessage((up,))
    static = RecordedMessage(TF_STATIC, TFMessage.TYPE, encode(transforms), 0, START)
    frame, shift = ("camera", 0.5) if upwards else ("mount", 0.0)
    before, records = steady(5, frame=frame), [r._replace(data=r.data) for r in steady(60, frame=frame)[10:]]
    aligner, found = aligned([*before, static, *records], block=7)
    assert aligner.counts[0].dropped == {Dropped.UNKNOWN_FRAME: 5}  # which came before it was known
    assert len(found) // 2 == aligner.made == 55
    for record in found[::2]:
        message = decode(record.type, record.data)
        index = (record.log_time_ns - START) // (10 * MS)
        np.testing.assert_allclose(message.position, (0.0, shift + 0.001 * index, 1.0), atol=1e-12)
    aligner, _ = aligned([static, *steady(60, frame="elsewhere")])
    assert aligner.counts[0].dropped == {Dropped.UNKNOWN_FRAME: 60}


def test_frames_in_a_circle_are_unknown_and_cost_one_look(monkeypatch):
    """The frames of `/tf_static` are gone through once for a frame, however many messages are in it."""
    circle = (TransformStamped(0, "a", "b", np.zeros(3)), TransformStamped(0, "b", "a", np.zeros(3)))
    static = RecordedMessage(TF_STATIC, TFMessage.TYPE, encode(TFMessage(circle)), 0, START)
    steps = []

    def placed(transform, poses):
        steps.append(transform)
        return poses

    monkeypatch.setattr(frames, "placed", placed)
    aligner, found = aligned([static, *steady(50, frame="a")], block=1)
    assert (found, aligner.counts[0].dropped) == ([], {Dropped.UNKNOWN_FRAME: 50})
    assert len(steps) == 2
