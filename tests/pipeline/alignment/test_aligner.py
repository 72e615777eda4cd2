"""Ticks are those of a plain version that goes message by message, and the same bits in whatever blocks they come."""

import hashlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_alignment import align
from plain_synchronizer import ApproximateTimeSynchronizer, TimeSynchronizer
from tracked_arm import JOINTS, MS, START, aligned, joints, pose

from recorders.cdr.codec import decode


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


@settings(max_examples=30)
@given(stalled_logs(), st.sampled_from([5, 100]), st.sampled_from([None, 100]), st.sampled_from([0, 1]), st.just(1))
def test_ticks_of_stalled_topics_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


@settings(max_examples=100)
@CASES
def test_ticks_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


@pytest.mark.campaign
@settings(max_examples=1000)
@CASES
def test_ticks_of_a_thousand_logs_are_those_of_the_plain_version(messages, tolerance_ms, period_ms, pivot, block):
    check_against_the_plain_version(messages, tolerance_ms, period_ms, pivot, block)


def between(messages, expected, period, pivot):
    """Return how many ticks there could be from the first that was made to the last."""
    first, last = expected[0][0], expected[-1][0]
    if period is not None:
        return (last - first) // period + 1
    stamps, latest = 0, 0
    for topic, stamp, _, _ in messages:
        if topic == ("/tracker", "/joint_states")[pivot] and stamp > latest:
            latest = stamp
            stamps += first <= stamp <= last
    return stamps


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
    if expected:
        assert aligner.missed == between(messages, expected, period, pivot) - aligner.made
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


@settings(max_examples=60)
@given(arrivals(), st.sampled_from([1, 3, 8192]))
def test_messages_of_one_stamp_are_the_ticks_of_a_synchronizer(messages, block):
    check_against_synchronizers(messages, block)


@pytest.mark.campaign
@settings(max_examples=1000)
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
