"""A motion in its own time, in this process: lag and settled error of a controller beside those who know the robot."""

import json
from pathlib import Path

import numpy as np
import pytest
from episodes import write_plain_episode
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.deployment.pink_guide import PinkGuide
from pipeline.deployment.real_time import LearnedGuide, RealTimeError, follow, lag_sentences, resampled
from pipeline.evaluation.errors import predicted_joints
from pipeline.learner.controller import Controller
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.simulation import Simulation
from pipeline.training.trainer import train
from recorders.errors import ConfigError
from replay.sources.schedule import Schedule

ROBOT = load_robot("asimo")
PERIOD_NS = 100_000_000


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Controller:
    log = write_plain_episode(tmp_path_factory.mktemp("log") / "log.mcap", measured=True)
    return train([log], schedule=Schedule(epochs=1), config=ForwardInverseConfig()).controller()


def a_move() -> Motion:
    """Both hands move by 4 cm in 0.2 s, and wait."""
    offsets = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.04], [0.0, 0.0, 0.04]])
    return Motion("move", 0.2 * np.arange(3), ROBOT.centres + offsets[:, np.newaxis], closed=False)


def test_targets_are_interpolated_in_the_motions_own_time() -> None:
    targets = resampled(a_move(), 50)
    assert targets.shape == (21, 2, 3)
    np.testing.assert_allclose(targets[::10], a_move().targets)
    np.testing.assert_allclose(targets[5], (a_move().targets[0] + a_move().targets[1]) / 2)


def test_orientations_are_interpolated_whatever_the_signs_of_their_quaternions() -> None:
    turned = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2], [0.1, 0.0, 0.2]])
    rows = np.concatenate([np.zeros((3, 3)), turned.as_quat() * [[1.0], [-1.0], [-1.0]]], axis=1)
    targets = resampled(Motion("turn", 0.2 * np.arange(3), rows[:, np.newaxis], closed=False), 10)[:, 0, 3:]
    found = Rotation.from_quat(targets)
    assert (found[::2] * turned.inv()).magnitude().max() < 1e-12
    np.testing.assert_allclose(found[1].as_rotvec(), [0.0, 0.0, 0.1], rtol=0.0, atol=1e-12)


def test_a_controller_moves_the_robot_as_its_commands_do_in_the_simulation(controller: Controller) -> None:
    targets = a_move().targets
    reached = follow(ROBOT, LearnedGuide(controller, period_ns=PERIOD_NS), targets, period_ns=PERIOD_NS)
    simulation = Simulation(ROBOT)
    simulation.reset(ROBOT.comfort)
    answers = predicted_joints(controller.learner(), targets.reshape(3, 6), len(ROBOT.joints))
    for command, hands in zip(np.clip(answers, ROBOT.lower, ROBOT.upper), reached, strict=True):
        simulation.advance(command, PERIOD_NS)
        np.testing.assert_array_equal(simulation.hands(), hands)


def test_pink_reaches_its_targets() -> None:
    guide, q, targets = PinkGuide(ROBOT), ROBOT.comfort, a_move().targets[-1]
    for _ in range(60):
        q = guide.step(q, targets)
    np.testing.assert_allclose(Kinematics(ROBOT).hands(q), targets, atol=1e-4)


def test_lag_is_named_where_it_is_most_of_the_error() -> None:
    errors = [RealTimeError("learned", 10, 0.1, 0.09), RealTimeError("learned", 50, 1.8, 0.03)]
    errors.append(RealTimeError("teacher", 10, 1.0, 0.01))
    (sentence,) = lag_sentences(errors)
    assert "At 50 Hz the lag of the robot's servos dominates" in sentence
    assert "1.80 cm" in sentence
    assert "0.03 cm" in sentence


def test_the_verb_shows_every_leader_moving_and_settled(controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "controller.npz")
    rows = [[0.1 * sample, *target.ravel()] for sample, target in enumerate(a_move().targets[:2])]
    text = "\n".join(["t,lx,ly,lz,rx,ry,rz", *(",".join(map(repr, map(float, row))) for row in rows)])
    (tmp_path / "move.csv").write_text(text)
    asked = ["evaluate", str(tmp_path / "controller.npz"), str(tmp_path / "move.csv"), "--own-time", "--json"]
    assert isinstance(CliRunner().invoke(app, asked).exception, ConfigError)
    run = CliRunner().invoke(app, [*asked, "--deploy"])
    assert run.exit_code == 0, run.output
    result = json.loads(run.stdout)
    for leader in ("teacher", "drake_ik", "pink"):
        for rate in (10, 50):
            assert result[f"{leader}_{rate}_hz_settled_cm"] < 0.1 < result[f"{leader}_{rate}_hz_cm"]
    assert {"learned_10_hz_cm", "learned_50_hz_settled_cm", "lag", "pairs"} <= set(result)
