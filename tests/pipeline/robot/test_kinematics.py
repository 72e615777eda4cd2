"""Hands as functions of the posture: by name, in the world frame, with the true Jacobian."""

import random
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.robot.config import load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from recorders.errors import JointError

ROBOT = load_robot("asimo")


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(ROBOT)


def postures(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(ROBOT.lower, ROBOT.upper, (count, len(ROBOT.joints)))


def posture(**angles: float) -> np.ndarray:
    return np.array([angles.get(name, 0.0) for name in ROBOT.joints])


def test_arms_hang_straight_down_at_zero(kinematics: Kinematics) -> None:
    shoulder_height = 0.6 + 0.02 + 0.02 + 0.29
    hand_height = shoulder_height - 0.21 - 0.175 - 0.08
    expected = [[0.0, 0.17 - 0.03, hand_height], [0.0, -0.17 + 0.03, hand_height]]
    np.testing.assert_allclose(kinematics.hands(posture()), expected, atol=1e-15)


def test_joints_turn_as_their_names_say(kinematics: Kinematics) -> None:
    rest = kinematics.hands(posture())
    np.testing.assert_allclose(kinematics.hands(posture(hip_height=0.03)) - rest, [[0, 0, 0.03]] * 2, atol=1e-15)
    raised = kinematics.hands(posture(left_elbow=-1.0))
    assert raised[0, 0] > rest[0, 0] + 0.1  # the left hand comes forward
    np.testing.assert_array_equal(raised[1], rest[1])  # and the right stays
    assert kinematics.hands(posture(hip_yaw=0.5))[1, 0] > rest[1, 0]  # turning left brings the right hand forward
    assert kinematics.hands(posture(hip_pitch=0.5))[0, 0] < rest[0, 0] + 0.1
    assert np.linalg.norm(kinematics.hands(posture(left_wrist=1.0))[0] - rest[0]) > 0.02  # the wrist moves the hand


def test_the_comfort_posture_holds_the_hands_near_the_centres(kinematics: Kinematics) -> None:
    centres = ROBOT.input_centre.reshape(2, 3)
    assert np.linalg.norm(kinematics.hands(ROBOT.comfort) - centres, axis=1).max() < 0.03


def test_the_head_does_not_move_the_hands(kinematics: Kinematics) -> None:
    _, jacobian = kinematics.hands_and_jacobian(postures(1)[0])
    np.testing.assert_array_equal(jacobian[:, ROBOT.joints.index("head_pan")], 0.0)


def test_the_jacobian_is_the_derivative_of_the_hands(kinematics: Kinematics) -> None:
    step = 1e-6
    for q in postures(20):
        hands, jacobian = kinematics.hands_and_jacobian(q)
        np.testing.assert_array_equal(hands, kinematics.hands(q))
        moved = [(kinematics.hands(q + d) - kinematics.hands(q - d)).ravel() for d in step * np.eye(len(q))]
        np.testing.assert_allclose(jacobian, np.array(moved).T / (2 * step), atol=1e-8)


def test_hands_along_is_hands_at_each_posture(kinematics: Kinematics) -> None:
    q = postures(7)
    np.testing.assert_array_equal(kinematics.hands_along(q), [kinematics.hands(row) for row in q])
    assert kinematics.hands_along(np.empty((0, 15))).shape == (0, 2, 3)


def test_the_order_of_the_urdf_does_not_matter(kinematics: Kinematics) -> None:
    urdf = ElementTree.fromstring(ROBOT.urdf_text)
    elements = list(urdf)
    random.Random(1).shuffle(elements)
    urdf[:] = elements
    shuffled = Kinematics(parse_robot(ROBOT.toml_text, ElementTree.tostring(urdf, encoding="unicode")))
    for q in postures(50):
        for mine, its in zip(kinematics.hands_and_jacobian(q), shuffled.hands_and_jacobian(q), strict=True):
            np.testing.assert_array_equal(mine, its)


def test_the_order_of_the_config_is_the_order_of_the_arrays(kinematics: Kinematics) -> None:
    lines = ROBOT.toml_text.splitlines()
    rows = [line for line in lines if line.startswith("    {")]
    backwards = ROBOT.toml_text.replace("\n".join(rows), "\n".join(reversed(rows)))
    reversed_kinematics = Kinematics(parse_robot(backwards, ROBOT.urdf_text))
    q = postures(1)[0]
    hands, jacobian = kinematics.hands_and_jacobian(q)
    reversed_hands, reversed_jacobian = reversed_kinematics.hands_and_jacobian(q[::-1])
    np.testing.assert_array_equal(reversed_hands, hands)
    np.testing.assert_array_equal(reversed_jacobian, jacobian[:, ::-1])
    np.testing.assert_array_equal(reversed_kinematics.inertia_diagonal(q[::-1]), kinematics.inertia_diagonal(q)[::-1])


def test_the_hip_lifts_all_but_the_legs(kinematics: Kinematics) -> None:
    assert kinematics.inertia_diagonal(ROBOT.comfort)[0] == pytest.approx(32.2 - 10.0)


def test_the_gaze_frame_sees_ahead_along_x(kinematics: Kinematics) -> None:
    ahead = kinematics.in_gaze_frame(posture(), [2.0, 0.0, 1.04])
    np.testing.assert_allclose(ahead, [2.0, 0.0, 0.0], atol=1e-12)
    turned = kinematics.in_gaze_frame(posture(head_pan=0.5), [2.0, 0.0, 1.04])
    assert turned[1] < 0.0


def test_a_posture_of_the_wrong_length_is_refused(kinematics: Kinematics) -> None:
    with pytest.raises(JointError, match=r"expected a posture of shape \(15,\), found \(14,\)"):
        kinematics.hands(np.zeros(14))


def test_versions_and_extensions_of_others_do_not_reach_pinocchio(capfd: pytest.CaptureFixture[str]) -> None:
    torn = ROBOT.urdf_text.replace('<robot name="asimo">', '<robot name="asimo" version="7"><sensor name="7"/>')
    robot = parse_robot(ROBOT.toml_text, torn)
    np.testing.assert_array_equal(Kinematics(robot).hands(robot.comfort), Kinematics(ROBOT).hands(ROBOT.comfort))
    assert capfd.readouterr() == ("", "")
