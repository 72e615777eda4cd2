"""A controller is tried with its own robot, beside the teacher and the baseline of the same samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode

from pipeline.evaluation.errors import HandErrors, hand_errors, linear_joints
from pipeline.evaluation.trials import evaluate_motion, evaluate_samples, robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairs import Samples, read_samples
from pipeline.training.trainer import train
from recorders.errors import ControllerError
from replay.sources.schedule import Schedule


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("trials") / "log.mcap", samples=20)


@pytest.fixture(scope="module")
def controller(log: Path) -> Controller:
    return train([log], schedule=Schedule(epochs=2), config=LearnerConfig(reservoir=40)).controller()


@pytest.fixture(scope="module")
def samples(log: Path) -> Samples:
    return read_samples(log)


def test_learned_teacher_and_baseline_are_what_they_are_called(
    controller: Controller, log: Path, samples: Samples
) -> None:
    trial = evaluate_motion(controller, log)
    kinematics = Kinematics(robot_of(controller))

    def errors(joints: np.ndarray) -> HandErrors:
        return HandErrors.of(hand_errors(kinematics, joints, samples.targets), ("left", "right"))

    learner = controller.learner()
    learner.washout(samples.targets[0], steps=10)
    assert np.array_equal(trial.joints, learner.predict(samples.targets)[:, 6:])
    assert trial.errors == errors(trial.joints)
    assert trial.teacher == errors(samples.joints)
    assert trial.linear == errors(linear_joints(samples.targets, samples.joints, asked=samples.targets))
    assert len({trial.errors.mean_cm, trial.teacher.mean_cm, trial.linear.mean_cm}) == 3
    assert np.array_equal(trial.reached, kinematics.hands_along(trial.joints))


def test_trying_changes_nothing(controller: Controller, log: Path) -> None:
    digest = controller.digest
    assert evaluate_motion(controller, log).errors == evaluate_motion(controller, log).errors
    assert controller.digest == digest


def test_a_motion_has_no_teacher(controller: Controller) -> None:
    trial = evaluate_motion(controller, "right_hand_drawing")
    assert trial.name == "right_hand_drawing"
    assert (trial.teacher, trial.linear) == (None, None)


def test_the_baseline_may_be_fitted_to_another_log(
    controller: Controller, log: Path, samples: Samples, tmp_path: Path
) -> None:
    longer = write_episode(tmp_path / "longer.mcap", samples=40)
    learned, kinematics = read_samples(longer), Kinematics(robot_of(controller))
    answers = linear_joints(learned.targets, learned.joints, asked=samples.targets)
    trial = evaluate_motion(controller, log, linear_from=longer)
    assert trial.linear == HandErrors.of(hand_errors(kinematics, answers, samples.targets), ("left", "right"))
    assert trial.linear != evaluate_motion(controller, log).linear
    assert trial.teacher == evaluate_motion(controller, log).teacher
    by_itself = evaluate_motion(controller, "right_hand_drawing", linear_from=longer)
    assert by_itself.linear is not None
    assert by_itself.teacher is None


def test_a_summary_names_whose_errors_they_are(controller: Controller, log: Path) -> None:
    trial = evaluate_motion(controller, log)
    summary = trial.summary()
    assert list(summary)[:5] == ["mean_cm", "max_cm", "left_cm", "right_cm", "left_max_cm"]
    for name, errors in (("teacher", trial.teacher), ("linear", trial.linear)):
        assert errors is not None
        found = [summary[f"{name}_{part}"] for part in ("cm", "left_cm", "right_cm")]
        assert found == [errors.mean_cm, *errors.hands_cm.values()]


def test_a_log_of_another_robot_is_refused(controller: Controller, samples: Samples) -> None:
    joints = ("wheel", *samples.robot.joints[1:])
    other = replace(samples, robot=replace(samples.robot, joints=joints, name="rover"))
    with pytest.raises(ControllerError, match=r"recorded with rover, which has wheel"):
        evaluate_samples(controller, other, name="log")
