"""The teacher brings both hands to their targets with the whole body, within limits, and always the same way."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.motions.motion import Motion, load_motion
from pipeline.motions.patterns.circles import circles
from pipeline.motions.patterns.eight import eight
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher, TeacherConfig, check_reach, find_unreachable
from recorders.errors import ConfigError, MotionError

ROBOT = load_robot("asimo")
CENTRES = ROBOT.input_centre.reshape(2, 3)


def shifted(x: float, y: float, z: float) -> np.ndarray:
    """Both centres, moved alike [m], shape (2, 3)."""
    return CENTRES + np.array([x, y, z])


def make_teacher(robot: RobotConfig = ROBOT, **parameters: float) -> Teacher:
    return Teacher(Kinematics(robot), TeacherConfig(**parameters))


def hold(teacher: Teacher, q: np.ndarray, targets: np.ndarray, seconds: float) -> np.ndarray:
    for _ in range(round(seconds * 1e9 / teacher.config.period_ns)):
        q = teacher.step(q, targets)
    return q


def cycle(teacher: Teacher, motion: Motion, q: np.ndarray) -> np.ndarray:
    """Postures at the end of every hold of 0.2 s."""
    return np.array([q := hold(teacher, q, targets, 0.2) for targets in motion.targets])


@pytest.mark.parametrize("offset", [[0, 0.1, 0.1], [0, -0.1, 0.1], [0.02, 0.2, -0.15], [-0.05, 0, 0]])
def test_the_hands_reach_their_targets(offset: list[float]) -> None:
    teacher = make_teacher()
    targets = shifted(*offset)
    q = hold(teacher, ROBOT.comfort, targets, 3.0)
    np.testing.assert_allclose(teacher.kinematics.hands(q), targets, atol=1e-3)


def test_a_step_is_the_published_formula() -> None:
    teacher = make_teacher()
    config, robot = teacher.config, ROBOT
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = robot.comfort + 0.1 * (robot.upper - robot.lower) * rng.uniform(-1, 1, 15)
        targets = CENTRES + rng.uniform(-0.1, 0.1, (2, 3))
        span = robot.upper - robot.lower
        ahead, aside, _ = teacher.kinematics.in_gaze_frame(q, targets.mean(axis=0))
        comfort = robot.comfort.copy()
        comfort[-1] = q[-1] + np.arctan2(aside, ahead)

        def cost(q: np.ndarray, comfort: np.ndarray = comfort, span: np.ndarray = span) -> np.ndarray:
            parts = (q - comfort) / span
            barrier = -np.log((q - robot.lower) / span) - np.log((robot.upper - q) / span)
            return robot.weights * parts**2 / 2 + config.barrier * barrier  # (n,): H is a sum over joints

        h = 1e-4 * span
        gradient = (cost(q + h) - cost(q - h)) / (2 * h)
        W = np.diag((cost(q + h) - 2 * cost(q) + cost(q - h)) / h**2)
        hands, J = teacher.kinematics.hands_and_jacobian(q)
        inverse = np.linalg.inv(W)
        z = -config.comfort_gain * inverse @ gradient
        xd = config.gain * (targets - hands).ravel()
        J_sharp = inverse @ J.T @ np.linalg.inv(J @ inverse @ J.T + config.damping**2 * np.eye(6))
        qd = z + J_sharp @ (xd - J @ z)
        np.testing.assert_allclose(teacher.step(q, targets), q + 0.005 * qd, atol=1e-6)


def test_the_posture_at_a_target_does_not_depend_on_the_way_there() -> None:
    teacher = make_teacher()
    spread = 0.1 * (ROBOT.upper - ROBOT.lower) * np.random.default_rng(0).uniform(-1, 1, (2, 15))
    ends = [hold(teacher, ROBOT.comfort + start, CENTRES, 6.0) for start in spread]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-4)


def test_cycles_repeat_with_comfort_and_drift_without() -> None:
    motion = eight(ROBOT)
    drift = {}
    for comfort_gain in (5.0, 0.0):
        teacher = make_teacher(comfort_gain=comfort_gain)
        first = cycle(teacher, motion, ROBOT.comfort)
        drift[comfort_gain] = np.abs(cycle(teacher, motion, first[-1]) - first)[-1].max()
    assert drift[5.0] < 1e-4
    assert drift[0.0] > 0.01


def test_cheap_hips_take_part() -> None:
    travel = {}
    for name, robot in {"cheap": ROBOT, "dear": replace(ROBOT, weights=np.ones(15))}.items():
        postures = cycle(make_teacher(robot), eight(ROBOT), ROBOT.comfort)
        travel[name] = np.ptp(postures, axis=0)[:4]
    assert (travel["cheap"] > travel["dear"]).all()
    assert (travel["cheap"][1:] > 0.05).all()  # rad


def test_the_head_follows_the_targets() -> None:
    teacher = make_teacher()
    for aside in (-0.2, 0.2):
        targets = shifted(0, aside, 0)
        q = hold(teacher, ROBOT.comfort, targets, 4.0)
        x, y, _ = teacher.kinematics.in_gaze_frame(q, targets.mean(axis=0))
        assert abs(np.arctan2(y, x)) < 0.1


def test_limits_are_kept_even_far_out_of_reach() -> None:
    teacher = make_teacher()
    q = ROBOT.comfort
    for targets in (shifted(0, 0, 9), shifted(-9, 0, -9), shifted(0, 9, 0)):
        for _ in range(300):
            q = teacher.step(q, targets)
            assert (q > ROBOT.lower).all()
            assert (q < ROBOT.upper).all()


def test_a_start_outside_the_limits_is_brought_back() -> None:
    q = make_teacher().step(ROBOT.upper + 1.0, CENTRES)
    assert np.isfinite(q).all()
    assert (q < ROBOT.upper).all()


@pytest.mark.parametrize("name", ["circles", "eight", "right_hand_drawing"])
def test_the_motions_that_come_with_the_program_are_within_reach(name: str) -> None:
    check_reach(make_teacher(), load_motion(name, ROBOT))


def test_the_whole_body_reaches_25_cm_about_the_right_centre() -> None:
    grid = np.linspace(-0.25, 0.25, 7)
    targets = np.array([CENTRES + np.array([[0, 0, 0], [0, y, z]]) for y in grid for z in grid])
    assert find_unreachable(make_teacher(), targets) is None


def test_a_point_out_of_reach_is_named_with_what_is_missing() -> None:
    motion = circles(ROBOT)
    targets = motion.targets.copy()
    targets[7, 1] = [1.5, -0.2, 0.76]
    far = Motion("far", motion.times_s, targets, closed=True)
    with pytest.raises(MotionError, match=r"'far' is out of reach: at sample 7 \(t = 1.4 s\) the right hand") as caught:
        check_reach(make_teacher(), far)
    assert "(1.500, -0.200, 0.760) m" in str(caught.value)
    miss = find_unreachable(make_teacher(), far.targets)
    assert miss is not None
    assert 0.5 < miss.short_m < 1.2


@pytest.mark.parametrize(
    "parameters",
    [{"gain": 0}, {"period_ns": 0}, {"damping": np.nan}, {"comfort_gain": -1}, {"barrier": np.inf}, {"margin": 0.5}],
)
def test_parameters_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"teacher {next(iter(parameters))}: expected"):
        TeacherConfig(**parameters)
