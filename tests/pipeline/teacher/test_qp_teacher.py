"""The second teacher keeps limits of joints, speeds and distances, and brings the hands there as the first one does."""

import numpy as np
import pytest

from pipeline.collision.self_distance import SelfDistance
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.part_distances import PartDistances
from pipeline.teacher.qp_config import SLACK_M, QpTeacherConfig
from pipeline.teacher.qp_teacher import QpTeacher
from pipeline.teacher.teacher import Teacher
from pipeline.urdf.description import parse_urdf
from pipeline.urdf.joints import speed_limits
from recorders.errors import ConfigError

ROBOT = load_robot("asimo")
KINEMATICS = Kinematics(ROBOT)


def follow(teacher: QpTeacher | Teacher, targets: np.ndarray, *, seconds: float, q: np.ndarray) -> np.ndarray:
    """Postures (T, n) on the way to targets (hands, 3)."""
    return np.array([q := teacher.step(q, targets) for _ in range(round(seconds * 1e9 / teacher.period_ns))])


@pytest.mark.parametrize("name", ["asimo", "g1", "talos", "icub"])
def test_the_hands_reach_their_targets(name: str) -> None:
    robot = load_robot(name)
    targets = robot.centres + 0.5 * np.array([hand.box for hand in robot.hands])
    reached = Kinematics(robot).hands(follow(QpTeacher(robot), targets, seconds=2.0, q=robot.comfort)[-1])
    np.testing.assert_allclose(reached, targets, atol=1e-3)


def test_hands_go_straight_to_their_targets_at_the_speed_of_the_gain() -> None:
    targets = ROBOT.centres + np.array([0.0, 0.02, 0.03])
    teacher = QpTeacher(ROBOT, QpTeacherConfig(clearance_m=0.0))
    hands = KINEMATICS.hands_along(follow(teacher, targets, seconds=0.2, q=ROBOT.comfort))
    left = targets - KINEMATICS.hands(ROBOT.comfort)
    step = 1.0 - teacher.config.gain * teacher.period_ns * 1e-9
    for k in (0, 9, 39):
        np.testing.assert_allclose(targets - hands[k], step ** (k + 1) * left, atol=2e-4)


def test_joints_stay_within_their_limits_of_position_and_speed() -> None:
    config = QpTeacherConfig(speed_share=0.2, margin=0.01)
    far = ROBOT.centres + np.array([[0.3, 0.3, 0.6], [0.3, -0.3, 0.6]])
    postures = follow(QpTeacher(ROBOT, config), far, seconds=2.0, q=ROBOT.comfort)
    span = ROBOT.upper - ROBOT.lower
    margins = np.minimum(postures - ROBOT.lower, ROBOT.upper - postures) / span
    assert margins.min() == pytest.approx(0.01, abs=1e-9)
    speeds = np.abs(np.diff(postures, axis=0, prepend=[ROBOT.comfort])) * 1e9 / config.period_ns
    shares = speeds / speed_limits(parse_urdf(ROBOT.urdf_text), ROBOT.joints)
    assert 0.19 < shares.max() < 0.2 + 1e-3


def test_parts_keep_their_distance_where_targets_would_bring_them_together() -> None:
    """Both hands are sent to one place; without the constraint, they meet there."""
    distances, closest = SelfDistance(ROBOT), {}
    middle = np.broadcast_to(ROBOT.centres.mean(axis=0), (2, 3))
    for clearance_m in (0.0, 0.05):
        teacher = QpTeacher(ROBOT, QpTeacherConfig(clearance_m=clearance_m))
        postures = follow(teacher, middle, seconds=2.0, q=ROBOT.comfort)[::10]
        closest[clearance_m] = min(distances.nearest(q).distance_m for q in postures)
    assert closest[0.0] < 0.0
    assert 0.05 - SLACK_M <= closest[0.05] < 0.051


def moved_about(robot: RobotConfig, count: int) -> np.ndarray:
    """Postures about the comfort posture (count, n)."""
    drawn = np.random.default_rng(4).uniform(-0.1, 0.1, (count, len(robot.joints)))
    return robot.comfort + drawn * (robot.upper - robot.lower)


def test_distances_are_those_of_the_robots_shapes_and_slopes_their_derivatives() -> None:
    parts, shapes = PartDistances(ROBOT), SelfDistance(ROBOT)
    for q in moved_about(ROBOT, 5):
        distances, slopes = parts.near(q, within_m=0.3)
        assert distances.min() == pytest.approx(shapes.nearest(q).distance_m, abs=1e-4)
        nearest = int(distances.argmin())
        step = 1e-3 * slopes[nearest] / np.linalg.norm(slopes[nearest])  # the steepest way up, and the other way down
        lower = parts.least(q - step, within_m=0.3)
        assert (distances.min() - lower) / 1e-3 == pytest.approx(np.linalg.norm(slopes[nearest]), rel=0.05)


def test_the_same_input_gives_the_same_output() -> None:
    targets = ROBOT.centres + 0.05
    one, other = (follow(QpTeacher(ROBOT), targets, seconds=0.5, q=ROBOT.comfort) for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("parameters", [{"gain": 0.0}, {"speed_share": -1.0}, {"clearance_m": -1.0}, {"margin": 0.5}])
def test_parameters_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="qp teacher"):
        QpTeacherConfig(**parameters)
