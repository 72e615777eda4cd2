"""Orientations that somebody shows are followed by hands whose pose is controlled: placed, smoothed, or refused."""

from pathlib import Path

import numpy as np
import pytest
from more_hands import write_robot
from scipy.spatial.transform import Rotation
from shown import ROBOT, poses_of, write_csv, write_log
from typer.testing import CliRunner

from pipeline.arrays import Floats
from pipeline.cli import app
from pipeline.exploration.demonstration import DemonstrationConfig, to_motion, turned_hands
from pipeline.exploration.hand_paths import DemonstratedPaths, read_csv_paths, read_log_paths
from pipeline.exploration.pose_track import HandPath
from pipeline.robot.config import RobotConfig, load_robot
from recorders.cdr.codec import decode_as
from recorders.errors import MotionError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import hand_target
from recorders.reading.reader import LogReader

HAND = "tip"
COLUMNS = "t,tip_x,tip_y,tip_z,tip_qx,tip_qy,tip_qz,tip_qw"
TIMES = np.linspace(0.0, 2.0, 201)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("posed") / "robot", (HAND,), poses=(HAND,))


@pytest.fixture(scope="module")
def robot(folder: Path) -> RobotConfig:
    return load_robot(folder)


def middle(robot: RobotConfig) -> Rotation:
    orientation = robot.hands[0].orientation
    assert orientation is not None
    return Rotation.from_quat(orientation)


def swing(times_s: Floats) -> Rotation:
    """Return small turns to and fro about two axes, from nowhere in particular."""
    angles = 0.15 * np.sin(np.pi * times_s)
    return Rotation.from_rotvec(np.outer(angles, [0.6, 0.0, 0.8])) * Rotation.from_rotvec([0.4, -0.7, 1.1])


def shown(robot: RobotConfig, turns: Rotation, *, times_s: Floats = TIMES) -> DemonstratedPaths:
    points = np.tile(robot.hands[0].centre, (len(times_s), 1))
    return DemonstratedPaths("shown", {HAND: HandPath(times_s, points, turns.as_quat())}, {"kind": "test"})


def asked(robot: RobotConfig, paths: DemonstratedPaths, **settings: object) -> tuple[Rotation, Floats]:
    motion = to_motion(robot, paths, config=DemonstrationConfig(**settings))
    return Rotation.from_quat(motion.targets[:, 0, 3:]), motion.times_s


def test_orientations_as_they_are_lie_on_great_arcs_between_those_shown(robot: RobotConfig) -> None:
    found, at_s = asked(robot, shown(robot, swing(TIMES)), align="as-is", smooth_s=0.0, hz=7.0)
    assert (found * swing(at_s).inv()).magnitude().max() < 1e-4  # an arc of 10 ms
    every, _ = asked(robot, shown(robot, swing(TIMES)), align="as-is", smooth_s=0.0, hz=10.0)
    assert (every * swing(TIMES[::10]).inv()).magnitude().max() < 2e-9


def test_the_mean_of_what_is_shown_becomes_the_middle(robot: RobotConfig) -> None:
    found, _ = asked(robot, shown(robot, swing(TIMES)), smooth_s=0.0)
    expected = swing(TIMES[::10]) * swing(TIMES).mean().inv() * middle(robot)
    assert (found * expected.inv()).magnitude().max() < 2e-9


def test_axes_of_a_source_turn_orientations_as_they_turn_positions(robot: RobotConfig) -> None:
    """A turn about the source's x, which is the robot's right, is one about that axis of the world."""
    turns = Rotation.from_rotvec(np.outer(0.2 * np.sin(np.pi * TIMES), [1.0, 0.0, 0.0]))
    found, at_s = asked(robot, shown(robot, turns), plane=("-x", "y"), smooth_s=0.0)
    expected = Rotation.from_rotvec(np.outer(0.2 * np.sin(np.pi * at_s), -robot.lateral)) * middle(robot)
    assert (found * expected.inv()).magnitude().max() < 2e-9


def test_noise_is_smoothed_away(robot: RobotConfig) -> None:
    noise = Rotation.from_rotvec(np.random.default_rng(3).normal(0.0, 0.02, (len(TIMES), 3)))
    paths = shown(robot, noise * swing(TIMES))
    rough, at_s = asked(robot, paths, align="as-is", smooth_s=0.0)
    smooth, _ = asked(robot, paths, align="as-is", smooth_s=0.3)
    errors = [(found * swing(at_s).inv()).magnitude() for found in (rough, smooth)]
    assert np.sqrt(np.mean(errors[1] ** 2)) < 0.5 * np.sqrt(np.mean(errors[0] ** 2))


def test_what_turns_too_far_is_one_line(robot: RobotConfig) -> None:
    turns = Rotation.from_rotvec(np.outer(np.linspace(-3.0, 3.0, len(TIMES)), [0.0, 0.0, 1.0]))
    with pytest.raises(MotionError, match=r"shown, tip: expected orientations within 149 degrees of their mean"):
        asked(robot, shown(robot, turns))


def test_poses_without_an_orientation_keep_the_middle(robot: RobotConfig) -> None:
    paths = shown(robot, swing(TIMES))
    path = paths.paths[HAND]
    nothing = DemonstratedPaths("none", {HAND: HandPath(path.times_s, path.points, np.zeros((len(TIMES), 4)))}, {})
    assert turned_hands(robot, nothing) == {}
    found, _ = asked(robot, nothing)
    assert (found * middle(robot).inv()).magnitude().max() < 1e-9


def test_columns_of_a_file_and_poses_of_a_log_show_orientations(
    robot: RobotConfig, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    points, quaternions = np.tile(robot.hands[0].centre, (len(TIMES), 1)), swing(TIMES).as_quat()
    file = write_csv(tmp_path / "shown.csv", COLUMNS, TIMES, points, quaternions)
    path = read_csv_paths(file, [HAND], posed=[HAND]).paths[HAND]
    assert path.quaternions is not None
    np.testing.assert_array_equal(path.quaternions, quaternions)
    assert caplog.text == ""
    assert read_csv_paths(file, [HAND]).paths[HAND].quaternions is None
    assert f"orientations of {HAND} are not followed" in caplog.text
    poses = [
        PoseStamped(pose.stamp_ns, pose.position, orientation=turn)
        for pose, turn in zip(poses_of(TIMES), quaternions, strict=True)
    ]
    log = write_log(tmp_path / "shown.mcap", {"/tracker": poses})
    recorded = read_log_paths(log, {"/tracker": HAND}).paths[HAND].quaternions
    assert recorded is not None
    np.testing.assert_array_equal(recorded, quaternions)
    lacking = write_csv(tmp_path / "lacking.csv", COLUMNS.rpartition(",")[0], TIMES, points, quaternions[:, :3])
    with pytest.raises(MotionError, match="lacks tip_qw: expected all four columns of an orientation"):
        read_csv_paths(lacking, [HAND], posed=[HAND])
    quaternions[4] = 0.0
    zero = write_csv(tmp_path / "zero.csv", COLUMNS, TIMES, points, quaternions)
    with pytest.raises(MotionError, match="row 5: expected an orientation of tip, found no length"):
        read_csv_paths(zero, [HAND], posed=[HAND])


def test_the_targets_of_the_log_turn_as_shown(robot: RobotConfig, folder: Path, tmp_path: Path) -> None:
    times_s = TIMES[:101]
    points, quaternions = np.tile(robot.hands[0].centre, (len(times_s), 1)), swing(times_s).as_quat()
    file = write_csv(tmp_path / "shown.csv", COLUMNS, times_s, points, quaternions)
    words = ["demonstrate", str(file), "--robot", str(folder), "--out", str(tmp_path / "log.mcap"), "--json"]
    run = CliRunner().invoke(app.app, words)
    assert run.exit_code == 0, run.exception or run.output
    log = LogReader(tmp_path / "log.mcap")
    assert log.manifest["demonstration"]["orientations"] == [HAND]
    targets = [decode_as(PoseStamped, record.data) for record in log.records(topics=[hand_target(HAND)])]
    turns = Rotation.from_quat([target.orientation for target in targets]) * middle(robot).inv()
    assert turns.magnitude().max() > 0.05


def test_robots_that_are_asked_for_positions_alone_take_no_orientations() -> None:
    """The same targets as ever."""
    path = HandPath(TIMES, np.tile(ROBOT.centres[1], (len(TIMES), 1)), swing(TIMES).as_quat())
    motion = to_motion(ROBOT, DemonstratedPaths("shown", {"right": path}, {}), config=DemonstrationConfig())
    assert motion.targets.shape[-1] == 3
