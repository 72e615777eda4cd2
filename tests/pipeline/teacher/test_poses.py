"""Whoever leads a hand whose pose is controlled turns it, too: both teachers, pink, and the search for reach."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from more_hands import THREE, write_robot

from pipeline.arrays import Floats
from pipeline.deployment.pink_guide import PinkGuide
from pipeline.exploration.episode import Guide
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.coordinates import centre_rows, to_inputs, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_setup.findings import findings
from pipeline.rotations import turns_between
from pipeline.teacher.qp_teacher import QpTeacher
from pipeline.teacher.reach import bring_within_reach
from pipeline.teacher.teacher import Teacher, check_reach, misses_m
from recorders.errors import MotionError

POSED = THREE[2]
WITH_PINK = pytest.param("pink", marks=pytest.mark.skipif(find_spec("pink") is None, reason="pink is not installed"))


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotConfig:
    return load_robot(write_robot(tmp_path_factory.mktemp("posed") / "robot", THREE, poses=(POSED,)))


def turned(robot: RobotConfig, part: float) -> Floats:
    """Return inputs in the middle of every box, the last hand turned by a part of what is explored."""
    inputs = robot.input_centre.copy()
    inputs[-3:] += part * robot.input_reach[-3:] * [1.0, -1.0, 1.0]
    return inputs


def guide_of(robot: RobotConfig, name: str) -> Guide:
    if name == "rates":
        return Teacher(Kinematics(robot))
    return QpTeacher(robot) if name == "qp" else PinkGuide(robot)


@pytest.mark.parametrize("name", ["rates", "qp", WITH_PINK])
def test_a_pose_is_reached_and_held(robot: RobotConfig, name: str) -> None:
    guide, wanted, q = guide_of(robot, name), turned(robot, 0.8), robot.comfort
    for _ in range(400):
        q = guide.step(q, to_rows(robot, wanted))
    found = Kinematics(robot).inputs(q)
    np.testing.assert_allclose(found[:-3], wanted[:-3], rtol=0.0, atol=2e-3)
    assert np.degrees(turns_between(found[-3:], wanted[-3:])) < 0.5
    untouched = Kinematics(robot).inputs(robot.comfort)[-3:]
    assert np.degrees(turns_between(untouched, wanted[-3:])) > 5.0


def test_a_turn_out_of_reach_is_found_and_brought_within(robot: RobotConfig) -> None:
    aside = turned(robot, 0.5)
    near = to_rows(robot, aside)
    aside[-3:] = [2.5, 0.0, 0.0]  # farther than the forearm rolls
    far = to_rows(robot, aside)
    motion = Motion("turns", np.arange(3.0), np.stack([near, far, near]), closed=False)
    teacher = Teacher(Kinematics(robot))
    with pytest.raises(MotionError, match=r"at sample 1 .* the third_arm hand of 'more' stays [\d.]+ cm short"):
        check_reach(teacher, motion)
    clipped, found = bring_within_reach(teacher, motion, choice="clip")
    assert (found.samples, found.hand) == (1, POSED)
    np.testing.assert_array_equal(clipped.targets[[0, 2]], motion.targets[[0, 2]])
    moved = misses_m(robot, clipped.targets[1], far)
    assert moved[2] > 0.02
    assert moved[:2].max() <= 0.005
    check_reach(teacher, Motion("clipped", np.arange(3.0), clipped.targets, closed=False))


def test_a_turn_counts_as_the_way_of_a_point_10_cm_off(robot: RobotConfig) -> None:
    middle = centre_rows(robot)
    aside = to_inputs(robot, middle)
    aside[-3:] = [0.0, 0.3, 0.0]
    np.testing.assert_allclose(misses_m(robot, middle, to_rows(robot, aside)), [0.0, 0.0, 0.03], rtol=0.0, atol=1e-15)


def test_a_box_of_turns_is_looked_at(robot: RobotConfig) -> None:
    """`robot check` tries the corners of turns, too."""
    assert list(findings(robot)) == []
    wide = replace(robot, hands=(*robot.hands[:2], replace(robot.hands[2], turn=(1.1, 1.1, 1.1))))
    (line,) = findings(wide)
    assert line.startswith("boxes of the hands: expected every corner within reach")


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_parts_that_are_built_into_each_other_stop_no_step(name: str) -> None:
    arm = load_robot(name)
    guide, q = QpTeacher(arm), arm.comfort
    target = to_rows(arm, arm.input_centre + 0.02)
    for _ in range(300):
        q = guide.step(q, target)
    assert misses_m(arm, Kinematics(arm).hands(q), target).max() < 2e-3
