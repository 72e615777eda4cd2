"""A controller drives the robot through `serve` and `robot`: to the bit the simulation, and beside it the teacher."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from episodes import write_episode

from pipeline.deployment import deploy as deployment
from pipeline.deployment.deploy import Deployment, DeploymentConfig, deploy, drive_learned
from pipeline.deployment.processes import served_robot
from pipeline.evaluation.errors import HandErrors, hand_errors, predicted_joints
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import Motion
from pipeline.motions.patterns.eight import eight
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_node.client import RemoteRobot
from pipeline.simulation.simulation import Simulation
from pipeline.teacher.teacher import Teacher
from pipeline.training.trainer import train
from recorders.errors import ConfigError, ReenactError, WireError
from replay.sources.schedule import Schedule

ROBOT = load_robot("asimo")
KINEMATICS = Kinematics(ROBOT)
SAMPLES = 6
CONFIG = DeploymentConfig(settle_steps=3)


def first_samples() -> Motion:
    whole = eight(ROBOT)
    return Motion("part", whole.times_s[:SAMPLES], whole.targets[:SAMPLES], closed=False)


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Controller:
    log = write_episode(tmp_path_factory.mktemp("deployment") / "log.mcap", samples=20)
    return train([log], schedule=Schedule(epochs=2), config=LearnerConfig(seed=3)).controller()


@pytest.fixture(scope="module")
def deployed(controller: Controller) -> Deployment:
    return deploy(controller, first_samples(), config=CONFIG)


@pytest.fixture(scope="module")
def served(controller: Controller) -> Iterator[tuple[zenoh.Session, RemoteRobot]]:
    with served_robot(controller, wait_s=120.0) as served:
        yield served


def held_targets() -> np.ndarray:
    """All targets that are said, the first again and again while the robot settles, shape (9, 2, 3)."""
    targets = first_samples().targets
    return np.concatenate([np.repeat(targets[:1], CONFIG.settle_steps, axis=0), targets])


def test_the_robot_does_what_the_simulation_does_under_the_same_commands(
    controller: Controller, deployed: Deployment
) -> None:
    answers = predicted_joints(controller.learner(), held_targets().reshape(-1, 6), len(ROBOT.joints))
    simulation = Simulation(ROBOT)
    simulation.reset(ROBOT.comfort)
    joints, hands = [], []
    for command in np.clip(answers, ROBOT.lower, ROBOT.upper):
        simulation.advance(command, CONFIG.period_ns)
        joints.append(simulation.positions)
        hands.append(simulation.hands())
    np.testing.assert_array_equal(deployed.learned.joints, joints[CONFIG.settle_steps :])
    reached, measured = KINEMATICS.hands_along(joints), np.array(hands)
    np.testing.assert_allclose(deployed.learned.reached, reached[CONFIG.settle_steps :], atol=1e-12)
    np.testing.assert_allclose(reached, measured, rtol=0, atol=2e-6)  # joints and hands are on grids


def test_the_teacher_leads_the_same_motion_at_the_same_pace(deployed: Deployment) -> None:
    simulation, teacher = Simulation(ROBOT), Teacher(KINEMATICS)
    simulation.reset(ROBOT.comfort)
    command, joints = ROBOT.comfort, []
    for target in held_targets():
        for _ in range(CONFIG.period_ns // teacher.config.period_ns):
            command = teacher.step(command, target)
            simulation.advance(command, teacher.config.period_ns)
        joints.append(simulation.positions)
    np.testing.assert_array_equal(deployed.teacher.joints, joints[CONFIG.settle_steps :])


def test_errors_are_of_the_physical_hands(deployed: Deployment) -> None:
    assert (deployed.motion, deployed.period_s) == ("part", 0.1)
    np.testing.assert_array_equal(deployed.targets, first_samples().targets.reshape(-1, 6))
    for run, mean_cm in ((deployed.learned, deployed.learned_cm), (deployed.teacher, deployed.teacher_cm)):
        assert run.errors == HandErrors.of(hand_errors(KINEMATICS, run.joints, deployed.targets), ("left", "right"))
        assert mean_cm == run.errors.mean_cm > 0.0
    assert deployed.learned_cm != deployed.teacher_cm


def test_it_repeats_to_the_bit_and_tells_how_far_it_is(controller: Controller, deployed: Deployment) -> None:
    done: list[float] = []
    again = deploy(controller, first_samples(), config=CONFIG, progress=done.append)
    assert again.learned.joints.tobytes() == deployed.learned.joints.tobytes()
    assert again.teacher.joints.tobytes() == deployed.teacher.joints.tobytes()
    assert len(done) == 2 * (CONFIG.settle_steps + SAMPLES)
    assert done == sorted(done)
    assert done[-1] == 1.0


@pytest.mark.parametrize("parameters", [{"period_ns": 0}, {"settle_steps": -1}, {"wait_s": -1.0}])
def test_parameters_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="deployment: expected"):
        DeploymentConfig(**parameters)


@pytest.mark.parametrize(
    ("config", "shift_m", "error", "message"),
    [
        (DeploymentConfig(period_ns=7_000_000), 0.0, ConfigError, "holds a command for 5000000 ns"),
        (CONFIG, 50.0, WireError, "targets at 0 ns were not answered within 1 s; did the controller refuse them"),
    ],
)
def test_what_cannot_be_driven_is_one_clear_line(
    served: tuple[zenoh.Session, RemoteRobot],
    monkeypatch: pytest.MonkeyPatch,
    config: DeploymentConfig,
    shift_m: float,
    error: type[ReenactError],
    message: str,
) -> None:
    monkeypatch.setattr(deployment, "_ANSWER_S", 1.0)
    with pytest.raises(error, match=message):
        drive_learned(*served, first_samples().targets + shift_m, config=config)


def test_a_controller_that_ends_is_named(controller: Controller, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deployment, "_ANSWER_S", 1.0)
    with pytest.raises(WireError, match="`serve` ended with status -9"):
        drive_without_controller(controller)


def drive_without_controller(controller: Controller) -> None:
    with served_robot(controller, wait_s=120.0) as (session, robot):
        os.kill(latest_child("serve"), signal.SIGKILL)
        drive_learned(session, robot, first_samples().targets, config=CONFIG)


def latest_child(word: str) -> int:
    """Return the id of the process that this one started last with a word among its arguments."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
    return [int(pid) for pid in children if word in Path(f"/proc/{pid}/cmdline").read_text().split("\0")][-1]
