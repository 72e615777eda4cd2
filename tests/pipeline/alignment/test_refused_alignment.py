"""What cannot be aligned, and an option that is wrong, are one line each."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab import MAPPED, START, anew, changed, recording, run
from mcap.writer import Writer
from sessions import write_foreign

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage


def still(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp, np.array((0.5, 0.0, 0.75))))


def no_quaternion(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp, pose.position, orientation=np.zeros(4)))


def an_hour_apart(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp + 3600 * 10**9, pose.position))


def other_joints(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/joint_states", lambda state, stamp: JointState(stamp, ("a", "b"), np.zeros(2)))


def unstamped(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(0, pose.position))


def backwards(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: replace(pose, stamp_ns=START + 5 * 10**9 - stamp % 10**9))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (still, "/tracker: expected a hand that moves as the joints do, found it at (0.5, 0, 0.75) m all the time"),
        (no_quaternion, "/tracker: expected messages that can be used, found 240 with a quaternion of zero length"),
        (an_hour_apart, "found those of /tracker 3600.005 s after"),
        (other_joints, "expected a topic of sensor_msgs/msg/JointState with the joints of the robot, turn, tip_yaw"),
        (other_joints, "found /joint_states without turn, tip_yaw, tip_shoulder, tip_elbow, with a, b"),
        (anew, "expected stamps of one clock, found a clock that began anew; take the times of recording with"),
        (
            backwards,
            "/tracker: expected stamps that rise in order of arrival, found 232 messages out of order and",
        ),
        (lambda records: [], "--map: expected a topic /tracker, found none; there are: none"),
        (unstamped, "found 240 without a stamp; take the times of recording with --clock log"),
    ],
)
def test_what_cannot_be_aligned_is_one_line(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Any, line: str
) -> None:
    bad = write_foreign(tmp_path / "bad.mcap", change(recording(robot)))
    assert run("train", bad, "--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz") == 2
    shown = capsys.readouterr().err
    assert line in shown
    assert shown.count("\n") == 1
    assert not (tmp_path / "x.npz").exists()


def test_a_topic_of_two_types_and_targets_that_are_not_there_are_one_line(
    log: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixed = tmp_path / "mixed.mcap"
    with mixed.open("wb") as file:
        writer = Writer(file)
        writer.start()
        mixture = [(message.TYPE, encode(message)) for message in (PoseStamped(START, np.zeros(3)), String(""))]
        tracked = [RecordedMessage("/tracker", kind, data, 0, START) for kind, data in mixture]
        for record in (*tracked, *recording(robot, tracked=False)[:9]):
            schema = writer.register_schema(record.type, "ros2msg", schema_text(record.type).encode())
            channel = writer.register_channel(record.topic, "cdr", schema)
            writer.add_message(channel, record.log_time_ns, record.data, record.log_time_ns)
        writer.finish()
    arguments = ("--robot", robot, "--out", tmp_path / "x.npz")
    assert run("train", mixed, *arguments, *MAPPED, "--rule", "forward-inverse") == 2
    line = f"/tracker: expected messages of one type, found {PoseStamped.TYPE}, {String.TYPE}"
    assert line in capsys.readouterr().err
    assert run("train", log, *arguments) == 2
    line = "expected messages on /hand/tip/target, found none; rename one of /tracker with --map, or learn from hands"
    line += " as measured or from joints alone, with --rule forward-inverse"
    assert line in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--tick-rate", "0"), "--tick-rate: expected a rate from 0.001 to 1000 Hz, found '0'"),
        (("--tick-rate", "10", "--ticks-of", "/tracker"), "expected one of --tick-rate and --ticks-of, found both"),
        (("--ticks-of", "/camera"), "--ticks-of: expected a topic of joints or poses, found /camera; there are: "),
        (("--latency", "/camera=0.1"), "--latency: expected a topic /camera, found none"),
        (("--latency", "/tracker=soon"), "--latency /tracker: expected seconds within 3600 of 0, such as 0.02, found"),
        (("--frame", "/tracker=1,2,3,0,0,0"), "--frame /tracker: expected seven numbers x,y,z,qx,qy,qz,qw, found"),
        (("--frame", "/tracker=1,2,3,0,0,0,0"), "--frame /tracker: expected a quaternion with a length, found"),
        (("--offset", "/camera=0,0,0,0,0,0,1"), "--offset: expected a topic /camera, found none"),
        (("--offset", "/tracker=0,0,0.1"), "--offset /tracker: expected seven numbers x,y,z,qx,qy,qz,qw, found"),
        (("--clock", "sun"), "--clock: expected header or log, found 'sun'"),
        (("--tolerance", "60"), "--tolerance: expected seconds within 5 of 0, such as 0.02, found '60'"),
        (("--tick-rate", "10", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
        (("--tolerance", "0.1", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
        (("--clock", "header", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
    ],
)
def test_a_wrong_option_is_one_line(
    log: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], line: str
) -> None:
    arguments = (log, "--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz", *options)
    assert run("train", *arguments) == 2
    shown = capsys.readouterr().err
    assert line in shown
    assert shown.count("\n") == 1
