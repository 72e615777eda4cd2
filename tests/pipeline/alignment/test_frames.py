"""Poses in other frames are those in the robot's, where the frame is known."""

import math

import numpy as np
import pytest
from tracked_arm import JOINTS, MS, SOURCES, START, aligned, steady

from pipeline.alignment import frames
from pipeline.alignment.blocks import Dropped
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.ticks import Aligner
from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import TFMessage, TransformStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import TF_STATIC


def test_frames_turn_poses_into_the_world():
    half = math.sqrt(0.5)
    quarter_about_z = (1.0, 2.0, 3.0, 0.0, 0.0, half, half)
    _, found = aligned(steady(frame="camera"), own=["camera"])
    options = AlignmentConfig(frames={"/tracker": quarter_about_z})
    aligner = Aligner(SOURCES, options, period_ns=None, pivot=0, frames=StaticFrames(["world"]))
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
