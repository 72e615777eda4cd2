"""Hands shown in a CSV file or by the poses of a log; what is of no use is left out and counted."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from shown import RIGHT, ROBOT, TRACKER, check_is_line, line_of, poses_of, write_csv, write_log

from pipeline.exploration.demonstration import DemonstrationConfig, to_motion
from pipeline.exploration.hand_paths import pose_topics, read_csv_paths, read_log_paths
from recorders.errors import LogError, MessageError, MotionError
from recorders.messages import topics
from recorders.messages.message_types import PoseStamped

AS_IS = DemonstrationConfig(align="as-is")


@pytest.mark.parametrize(
    ("header", "hand", "shown"),
    [
        ("t,rx,ry,rz", None, ["right"]),
        ("t,lx,ly,lz", None, ["left"]),
        ("t,x,y,z", "right", ["right"]),
        ("t,x,y,z", "left", ["left"]),
        ("t,lx,ly,lz,rx,ry,rz", None, ["left", "right"]),
        ("t,lx,ly,lz,rx,ry,rz", "right", ["right"]),
        ("note,rz,ry,rx,t", None, ["right"]),
    ],
)
def test_a_csv_shows_the_hands_whose_columns_it_has(
    tmp_path: Path, header: str, hand: str | None, shown: list[str]
) -> None:
    names = header.split(",")
    times_s = np.linspace(0.0, 1.0, 6)
    coordinates = dict(zip("xyz", line_of(times_s).T, strict=True))
    columns = [times_s if name == "t" else coordinates.get(name[-1], np.zeros(6)) for name in names]
    path = write_csv(tmp_path / "shown.csv", header, *columns)
    found = read_csv_paths(path, ("left", "right"), hand=hand)
    assert list(found.paths) == shown
    for part in found.paths.values():
        np.testing.assert_array_equal(part.times_s, times_s)
        np.testing.assert_array_equal(part.points, line_of(times_s))
    assert found.source["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (found.source["name"], found.source["hands"]) == ("shown.csv", shown)


@pytest.mark.parametrize(
    ("header", "hand", "message"),
    [
        ("t,x,y,z", None, "expected a hand for the columns x,y,z, as with --hand right, found t,x,y,z"),
        ("t,rx,ry,rz", "left", "the header lacks columns"),
        (
            "t,LX,ly,lz,rx,ry,rz",
            None,
            "the header lacks lx: expected all three columns of a hand, or none, found t,LX,",
        ),
        ("t,lx,rx,ry,rz", None, "the header lacks ly, lz: expected all three"),
        ("x,y,z", "right", "the header lacks columns: expected t and lx,ly,lz, rx,ry,rz, both, or x,y,z with a hand"),
    ],
)
def test_a_csv_with_other_columns_is_refused(tmp_path: Path, header: str, hand: str | None, message: str) -> None:
    path = write_csv(tmp_path / "shown.csv", header, *np.zeros((len(header.split(",")), 2)))
    with pytest.raises(MotionError, match=message):
        read_csv_paths(path, ("left", "right"), hand=hand)


def test_poses_of_a_log_are_timed_by_their_stamps(tmp_path: Path) -> None:
    path = write_log(tmp_path / "track.mcap", {TRACKER: poses_of(np.arange(0.0, 1.001, 0.0125))})
    shown = read_log_paths(path, pose_topics(TRACKER, ("left", "right"), hand=None))
    check_is_line(to_motion(ROBOT, shown, config=AS_IS), samples=11)
    assert shown.source["topics"] == {TRACKER: "right"}


def test_topics_are_renamed_so_that_two_trackers_are_two_hands(tmp_path: Path) -> None:
    times_s = np.linspace(0.0, 1.0, 11)
    path = write_log(tmp_path / "track.mcap", {"/a": poses_of(times_s), "/b": poses_of(times_s + 0.2)})
    renames = {"/a": topics.LEFT_TARGET, "/b": topics.RIGHT_TARGET}
    shown = read_log_paths(path, pose_topics(None, ("left", "right"), hand=None), renames=renames)
    assert list(shown.paths) == ["left", "right"]
    assert len(to_motion(ROBOT, shown, config=AS_IS)) == 9


def test_poses_of_no_use_are_left_out_and_counted(tmp_path: Path) -> None:
    poses = poses_of(np.arange(0.0, 1.001, 0.05))
    lost = PoseStamped(poses[4].stamp_ns + 1, [np.nan, 0.0, 0.0])
    far = PoseStamped(poses[4].stamp_ns + 2, [1e300, 0.0, 0.0])
    path = write_log(tmp_path / "track.mcap", {TRACKER: [*poses[:5], lost, far, poses[4], poses[2], *poses[5:]]})
    shown = read_log_paths(path, pose_topics(TRACKER, ("left", "right"), hand="right"))
    check_is_line(to_motion(ROBOT, shown, config=AS_IS), samples=11)
    assert shown.source["left_out"] == {"right": {"not a position": 2, "stamp not after the last": 2}}


def test_a_log_without_the_topic_names_those_it_has(tmp_path: Path) -> None:
    path = write_log(tmp_path / "track.mcap", {TRACKER: poses_of(np.arange(3.0))})
    with pytest.raises(LogError, match=rf"no message on /other; .*PoseStamped: {TRACKER}$"):
        read_log_paths(path, pose_topics("/other", ("left", "right"), hand=None))
    with pytest.raises(
        MessageError, match=r"track.mcap: /notes: expected geometry_msgs/msg/PoseStamped, found 'std_msgs"
    ):
        read_log_paths(path, pose_topics("/notes", ("left", "right"), hand=None))


def test_stamps_that_stand_still_are_no_demonstration(tmp_path: Path) -> None:
    path = write_log(tmp_path / "track.mcap", {TRACKER: [PoseStamped(0, RIGHT)] * 7})
    with pytest.raises(MotionError, match=r"two poses of the right hand, found 1; left out: 6 with stamp not after"):
        read_log_paths(path, pose_topics(TRACKER, ("left", "right"), hand="right"))


def test_a_gap_that_no_hand_makes_is_refused_with_its_pose(tmp_path: Path) -> None:
    near, far = (poses_of(np.array([0.0, 0.1, 0.2, 0.2 + gap_s])) for gap_s in (5.0, 5.001))
    shown = read_log_paths(
        write_log(tmp_path / "near.mcap", {TRACKER: near}), pose_topics(TRACKER, ("left", "right"), hand=None)
    )
    assert len(shown.paths["right"].times_s) == 4
    path = write_log(tmp_path / "far.mcap", {TRACKER: far})
    with pytest.raises(
        MessageError, match=rf"far\.mcap: {TRACKER}, pose 4: .* at most 5 s after .*, found 5\.001; are"
    ):
        read_log_paths(path, pose_topics(TRACKER, ("left", "right"), hand=None))


def test_milliseconds_taken_for_seconds_are_refused(tmp_path: Path) -> None:
    path = write_csv(
        tmp_path / "shown.csv", "t,rx,ry,rz", *np.column_stack([100.0 * np.arange(50), np.zeros((50, 3))]).T
    )
    with pytest.raises(MotionError, match=r"line 3, column t: .* found 100; are the times in seconds\?"):
        read_csv_paths(path, ("left", "right"))
