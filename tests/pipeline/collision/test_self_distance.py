"""Distances between a robot's hands and the rest of it are those of its shapes, whatever the posture."""

import math

import numpy as np
import pytest

from pipeline.collision.self_distance import NEIGHBOURS_M, NOTHING_NEAR, Nearest, SelfDistance
from pipeline.robot.config import RobotConfig, load_robot, parse_robot

ASIMO = load_robot("asimo")

URDF = """<robot name="two_rails">
  <link name="world"/>
  <link name="base">{body}</link>
  <joint name="ground" type="fixed"><parent link="world"/><child link="base"/></joint>
  {arm_left}{arm_right}
</robot>"""

ARM = """
  <link name="{side}_upper">{body}{inner}</link><link name="{side}_lower">{body}{shape}</link>
  <joint name="{side}_slide" type="prismatic"><parent link="base"/><child link="{side}_upper"/>
    <origin xyz="0 {y} 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="{side}_lift" type="prismatic"><parent link="{side}_upper"/><child link="{side}_lower"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <transmission name="{side}_slide"><type>transmission_interface/SimpleTransmission</type>
    <joint name="{side}_slide"/><actuator name="{side}_a"/></transmission>
  <transmission name="{side}_lift"><type>transmission_interface/SimpleTransmission</type>
    <joint name="{side}_lift"/><actuator name="{side}_b"/></transmission>"""

BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
DOT = '<visual><geometry><sphere radius="0.001"/></geometry></visual>'
BALL = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'


def two_rails(left: str = "", right: str = "", *, inner: str = DOT) -> RobotConfig:
    """A robot of two arms that slide along y and z, 1 m apart, each with a shape at its end and one inside."""
    arms = {
        side: ARM.format(side=side, y=y, body=BODY, inner=inner, shape=shape)
        for side, y, shape in (("left", 0.5, left), ("right", -0.5, right))
    }
    urdf = URDF.format(body=BODY, arm_left=arms["left"], arm_right=arms["right"])
    joints = [f"{side}_{name}" for side in ("left", "right") for name in ("slide", "lift")]
    rows = "\n".join(f'{{ name = "{name}", weight = 1.0, comfort = 0.0 }},' for name in joints)
    hands = "".join(
        f'[[hands]]\nname = "{side}"\nlink = "{side}_lower"\ncontrols = "position"\n'
        f"centre = [0.0, {y}, 0.5]\nbox = [0.1, 0.1, 0.1]\n"
        for side, y in (("left", 0.5), ("right", -0.5))
    )
    return parse_robot(f'name = "two_rails"\njoints = [{rows}]\n{hands}', urdf)


@pytest.mark.parametrize("nearer", [0.0, 0.3, 0.8, 0.9])
def test_two_balls_are_as_far_apart_as_geometry_says(nearer: float) -> None:
    distances = SelfDistance(two_rails(BALL, BALL))

    found = distances.nearest([-nearer, 0.0, 0.0, 0.2])

    apart = math.hypot(1.0 - nearer, 0.2) - 0.2
    assert found.distance_m == pytest.approx(apart, abs=1e-6)
    assert {found.first, found.second} == {"left_lower", "right_lower"}


def test_a_joint_without_a_shape_is_a_capsule_to_the_next() -> None:
    distances = SelfDistance(two_rails("", BALL, inner=""))

    found = distances.nearest(
        [-0.2, 0.0, 0.0, -0.25]
    )  # the ball is level with the middle of the other arm's upper part

    assert found.distance_m == pytest.approx(0.8 - 0.1 - 0.03, abs=1e-6)


def test_a_robot_without_anything_to_compare_has_no_pairs() -> None:
    distances = SelfDistance(two_rails(inner=""))

    assert distances.pairs == 0
    assert distances.nearest(np.zeros(4)) is NOTHING_NEAR


def test_postures_that_are_no_nearer_than_asked_give_back_what_was_asked() -> None:
    distances = SelfDistance(ASIMO)
    near = Nearest(0.01, "", "")

    assert distances.nearest(ASIMO.comfort, below=near) is near
    assert distances.nearest(ASIMO.comfort) is not NOTHING_NEAR


def test_the_smallest_distance_is_that_of_all_pairs() -> None:
    distances = SelfDistance(ASIMO)
    spread = 0.3 * (ASIMO.upper - ASIMO.lower)
    postures = ASIMO.comfort + spread * (np.random.default_rng(0).random((30, len(ASIMO.joints))) - 0.5)

    one_by_one = min((distances.nearest(posture) for posture in postures), key=lambda near: near.distance_m)
    running = NOTHING_NEAR
    for posture in postures:
        running = distances.nearest(posture, below=running)

    assert running == one_by_one


def test_hands_and_body_are_apart_in_the_comfort_posture() -> None:
    found = SelfDistance(ASIMO).nearest(ASIMO.comfort)

    assert NEIGHBOURS_M <= found.distance_m < 0.3


def test_forearms_that_cross_are_found() -> None:
    posture = ASIMO.comfort.copy()
    for side, inwards in (("left", -1.0), ("right", 1.0)):
        posture[ASIMO.joints.index(f"{side}_shoulder_yaw")] = inwards

    found = SelfDistance(ASIMO).nearest(np.clip(posture, ASIMO.lower, ASIMO.upper))

    assert found.distance_m < SelfDistance(ASIMO).nearest(ASIMO.comfort).distance_m
