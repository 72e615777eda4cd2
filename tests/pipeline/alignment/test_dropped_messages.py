"""Gaps and messages that are no samples change nothing of the ticks beside them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from tracked_arm import MS, START, aligned, joints, pose, steady

from pipeline.alignment.blocks import Dropped
from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import JointState


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
