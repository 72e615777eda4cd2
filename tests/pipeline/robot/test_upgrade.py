"""Robot configs of the older form, which lie in logs and controllers, are read as what they say."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from pipeline.resources import data_path
from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.recorded import recorded_robot
from pipeline.robot.resolution import UNLIMITED
from pipeline.robot.size import hand_joints
from recorders.errors import RobotError
from recorders.reading.reader import LogReader

OLDER = Path(__file__).with_name("older_configs")
CASES = sorted(data_path("golden").glob("*/*.mcap"))
ASIMO = load_robot("asimo")
BOX = (0.069, 0.25, 0.25)


def check_same(older: RobotConfig, today: RobotConfig) -> None:
    """Check that two robots differ in their texts and boxes alone, and that the older one has no resolution."""
    assert older.resolution == UNLIMITED != today.resolution
    for field in fields(RobotConfig):
        if field.name not in ("hands", "resolution", "toml_text"):
            np.testing.assert_array_equal(getattr(older, field.name), getattr(today, field.name))
    hands = [[(hand.name, hand.link, hand.controls, hand.centre) for hand in robot.hands] for robot in (older, today)]
    assert hands[0] == hands[1]
    assert [hand.box for hand in older.hands] == [BOX, BOX]


@pytest.mark.parametrize("name", sorted(path.stem for path in OLDER.glob("*.toml")))
def test_the_older_config_of_every_robot_is_the_robot_of_today(name: str) -> None:
    text, today = (OLDER / f"{name}.toml").read_text(), load_robot(name)
    older = parse_robot(text, today.urdf_text)
    assert older.toml_text == text != today.toml_text
    check_same(older, today)


@pytest.mark.parametrize("log", CASES, ids=lambda log: log.stem)
def test_the_logs_of_the_golden_cases_hold_the_robot_of_today(log: Path) -> None:
    robot = recorded_robot(LogReader(log))
    assert robot is not None
    assert robot.hands == ASIMO.hands
    if robot.resolution == UNLIMITED:
        assert robot.toml_text == (OLDER / "asimo.toml").read_text()
        check_same(robot, ASIMO)
    else:
        assert (robot.toml_text, robot.urdf_text) == (ASIMO.toml_text, ASIMO.urdf_text)


def test_one_log_of_the_golden_cases_is_of_the_older_form() -> None:
    older = {log.name for log in CASES if "[resolution]" not in LogReader(log).attachment("robot.toml").decode()}
    assert older == {"eight_v1.mcap"}


def test_the_box_of_an_older_config_lies_in_the_plane_of_its_patterns() -> None:
    text = (OLDER / "asimo.toml").read_text().replace("lateral = [0.0, 1.0, 0.0]", "lateral = [-1.0, 0.0, 0.0]")
    robot = parse_robot(text, ASIMO.urdf_text)
    assert [hand.box for hand in robot.hands] == [(0.25, 0.069, 0.25)] * 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('left = "left_hand"', "", r"\[hands\] lacks left: expected the keys left, right"),
        ("[hands]", '[hands]\nthird = "tail"', r"\[hands\] has unknown third"),
        ("left_centre = [0.32, 0.20, 0.76]", "", r"\[pattern\] lacks left_centre"),
        ("left_centre = [0.32,", "left_centre = [32,", "centre of hand left .* within 10 m of zero, found 32"),
        ('right = "right_hand"', 'right = "claw"', "frames claw of the robot config are not links"),
    ],
)
def test_a_wrong_config_of_the_older_form_is_one_clear_error(old: str, new: str, message: str) -> None:
    text = (OLDER / "asimo.toml").read_text()
    assert old in text
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(text.replace(old, new, 1), ASIMO.urdf_text)
    assert "\n" not in str(caught.value)


def test_a_hand_is_moved_by_the_joints_between_it_and_the_ground() -> None:
    names = {hand: [ASIMO.joints[place] for place in places] for hand, places in hand_joints(ASIMO).items()}
    hips = [f"hip_{name}" for name in ("height", "yaw", "pitch", "roll")]
    arm = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist")
    assert names == {side: [*hips, *(f"{side}_{name}" for name in arm)] for side in ("left", "right")}
