"""A hand whose pose is controlled, on an arm of seven joints in Drake: explored for 120 s, by a teacher or without."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from processes import reenact

from pipeline.motions.motion import csv_columns, orientation_columns
from pipeline.resources import data_path
from pipeline.robot.config import load_robot
from pipeline.robot.coordinates import to_rows
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.rotations import quaternions_of_matrices

ARM = "panda"
BOX = [0.1, 0.15, 0.1, 0.3, 0.3, 0.3]  # half extents [m] and [rad]
BOUND_CM, BOUND_DEG = 0.15, 0.3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm as it comes with the program, but for the pose of its hand: about that of its comfort posture."""
    folder = tmp_path_factory.mktemp("arm") / ARM
    shutil.copytree(data_path("robots", ARM), folder)
    robot = load_robot(ARM)
    (hand,), (_, rotations) = robot.hands, HandKinematics(robot).poses(robot.comfort)
    turned = quaternions_of_matrices(rotations[0])
    middle = np.round(turned / np.linalg.norm(turned), 6).tolist()
    text = robot.toml_text
    for old, new in (
        ('controls = "position"', 'controls = "pose"'),
        (f"centre = {list(hand.centre)}", f"centre = {[*hand.centre, *middle]}"),
        (f"box = {list(hand.box)}", f"box = {BOX}"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "robot.toml").write_text(text)
    return folder


def write_motion(path: Path, folder: Path) -> Path:
    """Write a motion through the box that no exploration is trained on: six waves of periods of their own."""
    robot, times_s = load_robot(folder), np.arange(0.0, 20.0, 0.1)
    waves = np.sin(np.outer(times_s, [1.3, 0.9, 1.1, 0.8, 1.2, 1.5]) + np.arange(6.0))
    rows = to_rows(robot, robot.input_centre + 0.7 * robot.input_reach * waves)[:, 0]
    (name,) = robot.hand_names
    header = ",".join([*csv_columns([name]), *orientation_columns(name)])
    np.savetxt(path, np.column_stack([times_s, rows]), delimiter=",", header=header, comments="", fmt="%.9f")
    return path


@pytest.mark.campaign
@pytest.mark.parametrize("leader", [("--motion", "volume"), ("--no-teacher",)], ids=["teacher", "alone"])
def test_poses_are_learned_in_two_minutes(leader: tuple[str, ...], folder: Path, tmp_path: Path) -> None:
    motion = write_motion(tmp_path / "waves.csv", folder)
    for command in (
        ("explore", "--robot", folder, *leader, "--duration", 120, "--tick-rate", 25, "--out", "log.mcap"),
        ("train", "log.mcap", "--rule", "forward-inverse", "--out", "arm.npz"),
        ("evaluate", "arm.npz", motion, "--json"),
    ):
        run = reenact(*command, cwd=tmp_path, timeout_s=1200.0)
        assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert (found["hand_cm"] <= BOUND_CM, found["hand_deg"] <= BOUND_DEG) == (True, True), found
