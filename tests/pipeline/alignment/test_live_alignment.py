"""Messages as they come make the ticks that their recording has, through holes, frames, phases and resets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lab import MS, START, anew, changed, recording
from sessions import write_foreign

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.live import LiveAligner, LiveInputs
from pipeline.robot.config import load_robot
from recorders.cdr.codec import encode
from recorders.containers.opening import open_log
from recorders.errors import LogError
from recorders.messages.message_types import TFMessage, TransformStamped
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage


@pytest.mark.parametrize("period_ns", [None, 20 * MS, 33_333_333])
def test_live_ticks_are_those_of_the_file(robot: Path, period_ns: int | None) -> None:
    """One by one, as they arrive, with a hole, and with latecomers."""
    records = [r for r in recording(robot) if not 3 * 10**9 < r.log_time_ns - START < 4 * 10**9]
    records[200:200] = records[100:120]
    config = AlignmentConfig(period_ns=period_ns, latencies_ns={"/tracker": 7 * MS})
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    log = write_foreign(robot.parent / "live.mcap", records)
    aligner = LiveAligner(load_robot(robot), config, renames=renames, tick=tick)
    live = [[*aligner.feed(record)] for record in open_log(log).records(file_order=True)]
    made = [message for messages in live for message in messages]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert made == list(by_file)
    assert max(map(len, live)) == (4 if period_ns == 20 * MS else 2)  # each tick as soon as it is complete
    assert aligner.counts["unaligned"] == 20
    aligner.begin()
    assert [m for r in recording(robot)[:100] for m in aligner.feed(r)]  # stamps start anew


def test_a_frame_is_known_from_its_transform_on_live_as_in_the_file(
    robot: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Poses in it that came before are dropped and counted."""
    records = changed(recording(robot), "/tracker", lambda pose, stamp: replace(pose, frame_id="cam"))
    static = TFMessage((TransformStamped(0, "world", "cam", np.array((0.0, 0.0, 1.0))),))
    at = [place for place, record in enumerate(records) if record.topic == "/tracker"][19]
    records[at:at] = [RecordedMessage("/tf_static", TFMessage.TYPE, encode(static), 0, records[at].log_time_ns)]
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    log = write_foreign(robot.parent / "frames.mcap", records)
    aligner = LiveAligner(load_robot(robot), AlignmentConfig(), renames=renames, tick=tick)
    live = [message for record in open_log(log).records(file_order=True) for message in aligner.feed(record)]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=AlignmentConfig(), renames=renames, wanted=tick)
    assert live == list(by_file)
    assert by_file.counts["/hand/tip/measured"] == 240 - 19
    assert aligner.counts["unaligned"] == 19
    assert [record.getMessage() for record in caplog.records] == [
        "/tracker: expected poses in the robot's frame or one that /tf_static joins to it, found cam; give "
        "--frame /tracker=x,y,z,qx,qy,qz,qw"
    ]


@pytest.mark.parametrize("period_ns", [None, 20 * MS])
def test_a_phase_marker_cuts_live_as_in_the_file(robot: Path, period_ns: int | None) -> None:
    records = recording(robot)
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    marker = RecordedMessage("/session/phase", message.TYPE, encode(message), 0, records[500].log_time_ns)
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    config = AlignmentConfig(period_ns=period_ns)
    log = write_foreign(robot.parent / "marked.mcap", [*records[:500], marker, *records[500:]])
    inputs = LiveInputs(load_robot(robot), config, renames=renames, tick=tick)
    arrived = open_log(log).records(file_order=True)
    live = [made for record in arrived for made, _ in inputs.feed(record, numbered=True)]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert [made for made in live if made.topic != "/session/phase"] == list(by_file)
    assert by_file.summary.episodes == 2


def test_a_log_whose_stamps_begin_anew_with_a_phase_is_one_line(robot: Path) -> None:
    records = recording(robot)[:400]
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    marker = RecordedMessage("/session/phase", message.TYPE, encode(message), 0, records[-1].log_time_ns)
    again = [record._replace(log_time_ns=record.log_time_ns + 10 * 10**9) for record in records]
    log = write_foreign(robot.parent / "again.mcap", [*records, marker, *again])
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    with pytest.raises(LogError, match="found a clock that began anew; take the times of recording with --clock log"):
        AlignedLog(open_log(log), load_robot(robot), config=AlignmentConfig(), renames=renames, wanted=tick)
    config = AlignmentConfig(clock="log")
    by_log_time = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert by_log_time.summary.episodes == 2


def test_a_clock_that_begins_anew_is_followed_live(robot: Path) -> None:
    """A simulator is reset: after ten messages of each topic there are ticks again, each as soon as it is complete."""
    records = recording(robot)
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    for period_ns in (None, 20 * MS):
        config = AlignmentConfig(period_ns=period_ns)
        aligner = LiveAligner(load_robot(robot), config, renames=renames, tick=tick)
        assert [made for record in records for made in aligner.feed(record)]
        again = [[*aligner.feed(record)] for record in anew([*records[:1], *records])[-len(records) // 2 :]]
        first = next(place for place, made in enumerate(again) if made)
        assert first < 50
        assert max(map(len, again)) == (4 if period_ns else 2)
