"""Stamps that come late, leap, begin anew or cannot be, and topics that fall silent."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracked_arm import MS, SOURCES, START, aligned, joints, pose, shifted, steady

from pipeline.alignment.blocks import Dropped
from recorders.cdr.codec import decode


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


@settings(max_examples=40)
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


def test_latency_shifts_stamps_and_the_log_clock_replaces_them():
    records = [r._replace(log_time_ns=r.log_time_ns + 3 * MS) for r in steady()]
    _, found = aligned(records, latencies_ns={"/tracker": 5 * MS, "/joint_states": -MS}, period=10 * MS)
    at = {r.log_time_ns: decode(r.type, r.data).position for r in found[::2]}
    np.testing.assert_allclose(at[START + 200 * MS][0], 0.0205, rtol=0, atol=1e-12)
    unstamped = [joints(0, (0.01 * i, 0.0), log_time=START + i * 10 * MS) for i in range(100)]
    unstamped = [r for pair in zip(unstamped, steady()[1::2], strict=True) for r in pair]
    aligner, found = aligned(unstamped, clock="log")
    assert aligner.made == 100
