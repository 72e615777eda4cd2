"""Eq. (10) is what the text of the paper says it is, and the baseline is plain least squares."""

import numpy as np
import pytest

from pipeline.evaluation.errors import HandErrors, hand_errors, linear_joints, predicted_joints
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from recorders.errors import ConfigError

HANDS = ("left", "right")


def test_errors_are_distances_of_each_hand() -> None:
    robot = load_robot("asimo")
    kinematics = Kinematics(robot)
    joints = np.stack([robot.comfort, robot.comfort])
    offsets = np.array([[[0.03, 0.04, 0.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 0.01, 0.0]]])
    targets = kinematics.hands_along(joints) + offsets
    errors = hand_errors(kinematics, joints, targets.reshape(2, 6))
    assert errors == pytest.approx(np.array([[0.05, 0.0], [0.0, 0.01]]), abs=1e-12)
    summary = HandErrors.of(errors, HANDS)
    assert summary.mean_cm == pytest.approx((5.0 + 1.0) / 4)  # over time and both hands
    assert (summary.hands_cm["left"], summary.hands_cm["right"]) == pytest.approx((2.5, 0.5))
    assert (summary.max_cm, summary.hands_max_cm["left"], summary.hands_max_cm["right"]) == pytest.approx(
        (5.0, 5.0, 1.0)
    )
    assert summary.samples == 2


def test_each_hands_error_is_the_mean_over_time() -> None:
    summary = HandErrors.of(np.array([[0.01, 0.0], [0.01, 0.0], [0.01, 0.06], [0.09, 0.06]]), HANDS)
    assert (summary.hands_cm["left"], summary.hands_cm["right"]) == pytest.approx((3.0, 3.0))
    assert summary.mean_cm == pytest.approx((summary.hands_cm["left"] + summary.hands_cm["right"]) / 2.0)
    assert (summary.hands_max_cm["left"], summary.hands_max_cm["right"]) == pytest.approx((9.0, 6.0))
    skewed = HandErrors.of(np.array([[0.0, 0.03], [0.0, 0.02], [0.06, 0.02]]), HANDS)
    assert (skewed.hands_cm["left"], skewed.hands_cm["right"]) == pytest.approx((2.0, 7.0 / 3.0))


def test_errors_beyond_all_numbers_mean_that_learning_diverged() -> None:
    robot = load_robot("asimo")
    far = np.where(np.array(robot.joints) == "hip_height", 1e200, robot.comfort)[None]
    errors = hand_errors(Kinematics(robot), far, np.zeros((1, 6)))
    with pytest.raises(ConfigError, match="learning diverged: the hands' errors are no longer finite"):
        HandErrors.of(errors, HANDS)


def test_the_first_target_is_held_for_ten_steps_and_outputs_are_joints() -> None:
    class Recorder:
        def __init__(self) -> None:
            self.seen: list[tuple[str, object]] = []

        def washout(self, u0: np.ndarray, *, steps: int) -> None:
            self.seen.append(("washout", (tuple(u0), steps)))

        def predict(self, u: np.ndarray) -> np.ndarray:
            self.seen.append(("predict", len(u)))
            return np.arange(len(u) * 8.0).reshape(len(u), 8)

    recorder, targets = Recorder(), np.arange(18.0).reshape(3, 6)
    joints = predicted_joints(recorder, targets, 2)
    assert recorder.seen == [("washout", (tuple(targets[0]), 10)), ("predict", 3)]
    assert joints.tolist() == [[6.0, 7.0], [14.0, 15.0], [22.0, 23.0]]


def test_the_baseline_finds_an_affine_map() -> None:
    generator = np.random.default_rng(1)
    targets = generator.uniform(size=(40, 6))
    joints = targets @ generator.uniform(size=(6, 4)) + 0.7
    assert linear_joints(targets[:20], joints[:20], asked=targets) == pytest.approx(joints, abs=1e-10)


def test_the_baseline_does_not_answer_to_what_it_was_never_shown() -> None:
    generator = np.random.default_rng(2)
    targets, joints = generator.uniform(size=(40, 6)), generator.uniform(size=(40, 4))
    targets[:, 1] = targets[:, 4] - 0.4  # both hands always move alike sideways
    apart = targets + np.array([0.0, 0.1, 0.0, 0.0, -0.1, 0.0])
    shown = linear_joints(targets, joints, asked=targets)
    assert linear_joints(targets, joints, asked=apart) == pytest.approx(shown, abs=1e-10)
