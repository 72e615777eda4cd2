"""What teaches nothing is an error, and what teaches little is named in a line."""

import json
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from typer.testing import CliRunner

from pipeline.arrays import Floats
from pipeline.cli.app import app, main
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.training.joint_extent import FEW_SAMPLES, JointExtent
from recorders.errors import LearningError
from recorders.messages.message_types import JointState
from recorders.messages.topics import JOINT_STATES
from recorders.writing.writer import LogWriter


@pytest.fixture(scope="module")
def robot() -> RobotConfig:
    return load_robot("asimo")


def postures(robot: RobotConfig, share: float) -> Floats:
    """Return two postures that differ by a share of every joint's range."""
    return np.stack([robot.comfort, robot.comfort + share * (robot.upper - robot.lower)])


def extent_of(robot: RobotConfig, joints: Floats) -> JointExtent:
    extent = JointExtent(robot)
    for posture in joints:
        extent.take(posture[np.newaxis])
    return extent


def test_joints_of_which_none_moves_are_an_error(robot: RobotConfig) -> None:
    with pytest.raises(LearningError, match=r"expected joints that move, found all within 0\.1% of their range"):
        extent_of(robot, postures(robot, 0.0005)).check_moved(2)
    moved = postures(robot, 0.0)
    moved[1, 2] += 0.002 * (robot.upper[2] - robot.lower[2])
    extent_of(robot, moved).check_moved(2)


def test_joints_that_hardly_move_and_few_samples_are_named(robot: RobotConfig) -> None:
    joints = postures(robot, 0.05)
    joints[1, 2] = joints[0, 2]
    few, still = extent_of(robot, joints).notes(FEW_SAMPLES - 1)
    assert few.startswith("49 samples are few")
    assert "which teaches next to nothing: " + robot.joints[2] + " (" in still
    assert sum(name in still for name in robot.joints) == 1
    assert extent_of(robot, postures(robot, 0.05)).notes(FEW_SAMPLES) == []


def test_joints_beyond_their_limits_are_named(robot: RobotConfig) -> None:
    joints = postures(robot, 0.05)
    joints[1, 1] = robot.upper[1] + 0.02 * (robot.upper[1] - robot.lower[1])
    (beyond,) = extent_of(robot, joints).notes(FEW_SAMPLES)
    assert beyond.startswith("beyond their limits, where commands stop, so that hands miss: " + robot.joints[1])


def test_train_names_few_samples(tmp_path: Path) -> None:
    log, out = write_episode(tmp_path / "log.mcap", samples=12), tmp_path / "few.npz"
    arguments = ["train", str(log), "--epochs", "1", "--overwrite", "--out", str(out)]
    shown = CliRunner().invoke(app, arguments)
    assert "12 samples are few" in shown.stdout
    assert json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)["notes"][0].startswith("12 samples")


def test_a_robot_at_rest_trains_no_controller(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, log, out = load_robot("asimo"), tmp_path / "rest.mcap", tmp_path / "rest.npz"
    with LogWriter(log, manifest={}) as writer:
        for stamp in range(10_000_000, 2_000_000_000, 10_000_000):
            writer.write(JOINT_STATES, JointState(stamp, robot.joints, robot.comfort), log_time_ns=stamp)
    arguments = ["train", str(log), "--robot", "asimo", "--rule", "forward-inverse", "--out", str(out)]
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "nothing was learned: expected joints that move" in capsys.readouterr().err
    assert not out.exists()
