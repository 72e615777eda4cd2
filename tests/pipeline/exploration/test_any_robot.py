"""Other robots, from config alone: explored, learned from and evaluated by the same code as asimo."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import reenact
from small_robot import JOINTS, write_robot

from pipeline.evaluation.trials import evaluate_motion
from pipeline.exploration.explore import explore
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import Motion, load_motion
from pipeline.resources import data_path
from pipeline.robot.config import RobotConfig, load_robot, parse_robot, robot_names
from pipeline.robot.importing.import_spec import parse_source
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import UNLIMITED
from pipeline.samples.pairs import read_samples
from pipeline.simulation.simulation import Simulation
from pipeline.teacher.teacher import Teacher, find_unreachable
from pipeline.training.trainer import train
from recorders.errors import RobotError
from recorders.rerun_scene.recording import record_motion
from replay.sources.schedule import Schedule

IMPORTED = {"icub": 15, "g1": 14, "talos": 15}
SAMPLES = 10

ARMS = {  # largest mean error [cm] on a motion never trained, after 120 s of exploration
    "panda": 0.03,
    "ur5": 0.02,
    "so101": 0.05,
    "baxter": 0.05,
}


def load(name: str, tmp_path: Path) -> RobotConfig:
    return load_robot(write_robot(tmp_path / "robot") if name == "small" else name)


def short_motion(robot: RobotConfig) -> Motion:
    """Ten samples of a circle with each hand, in the robot's own plane."""
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    circle = 0.08 * (np.outer(np.cos(angle), robot.lateral) + np.outer(np.sin(angle), robot.up))
    targets = np.stack([robot.centres[0] + circle, robot.centres[1] - circle], axis=1)
    return Motion("short", 0.2 * np.arange(SAMPLES), targets, closed=False)


def write_csv(path: Path, motion: Motion) -> Path:
    rows = np.column_stack([motion.times_s, motion.targets.reshape(len(motion), -1)])
    np.savetxt(path, rows, delimiter=",", header="t,lx,ly,lz,rx,ry,rz", comments="")
    return path


def test_the_robots_that_come_with_the_program() -> None:
    assert robot_names() == sorted(["asimo", *IMPORTED, *ARMS])


@pytest.mark.parametrize(("name", "joints"), IMPORTED.items())
def test_a_robot_stands_as_its_config_says(name: str, joints: int) -> None:
    robot = load_robot(name)
    assert len(robot.joints) == joints
    kinematics = Kinematics(robot)
    left, right = kinematics.hands(robot.comfort)
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=0.002)  # the same on both sides
    np.testing.assert_allclose([left, right], [robot.centres[0], robot.centres[1]], atol=0.06)
    ahead, aside, _ = kinematics.in_gaze_frame(robot.comfort, (robot.centres[0] + robot.centres[1]) / 2)
    assert ahead > 0.1
    assert abs(aside) < 1e-3
    turned = robot.comfort.copy()
    turned[robot.joints.index(robot.gaze.joint)] += 0.2
    assert kinematics.in_gaze_frame(turned, (robot.centres[0] + robot.centres[1]) / 2)[1] < -0.01


@pytest.mark.parametrize("name", [*IMPORTED, "small"])
def test_every_joint_of_an_arm_moves_its_hand_and_drake_agrees(name: str, tmp_path: Path) -> None:
    robot = load(name, tmp_path)
    kinematics, simulation = Kinematics(robot), Simulation(replace(robot, resolution=UNLIMITED))
    q = robot.comfort + 0.1 * np.linspace(-1.0, 1.0, len(robot.joints)) * (robot.upper - robot.lower)
    simulation.reset(np.clip(q, robot.lower, robot.upper))
    np.testing.assert_allclose(simulation.hands(), kinematics.hands(simulation.positions), atol=1e-12)
    moved = np.abs(kinematics.hands_and_jacobian(robot.comfort)[1]).max(axis=0)
    still = [joint for joint, most in zip(robot.joints, moved, strict=True) if most < 0.02]
    assert still == [joint for joint in (robot.gaze.joint,) if joint in ("neck_yaw", "head_2_joint")]


@pytest.mark.parametrize("name", [*IMPORTED, "small"])
@pytest.mark.parametrize("pattern", ["circles", "eight"])
def test_both_patterns_are_in_reach(name: str, pattern: str, tmp_path: Path) -> None:
    robot = load(name, tmp_path)
    targets = load_motion(pattern, robot).targets
    assert find_unreachable(Teacher(Kinematics(robot)), targets[:: len(targets) // 16]) is None


@pytest.mark.parametrize("name", [*IMPORTED, "small"])
def test_explored_learned_and_evaluated(name: str, tmp_path: Path) -> None:
    robot = load(name, tmp_path)
    explored = explore(robot, short_motion(robot), seed=0, out=tmp_path / "short.mcap")
    samples = read_samples(explored.path)
    assert samples.robot.urdf_text == robot.urdf_text
    assert explored.teacher_error_cm < 2.0
    trainer = train([explored.path], schedule=Schedule(epochs=20), config=LearnerConfig(seed=0, epochs=20))
    trial = evaluate_motion(trainer.controller(), explored.path)
    untrained = train([explored.path], schedule=Schedule(epochs=1), config=LearnerConfig(seed=0, epochs=1))
    assert trial.joints.shape == (SAMPLES, len(robot.joints))
    assert trial.errors.mean_cm < evaluate_motion(untrained.controller(), explored.path).errors.mean_cm
    assert trial.teacher is not None
    assert trial.teacher.mean_cm == pytest.approx(explored.teacher_error_cm, abs=0.01)


@pytest.mark.parametrize("name", [*IMPORTED, "small"])
def test_a_viewer_draws_it_without_any_file_of_its_own(name: str, tmp_path: Path) -> None:
    robot = load(name, tmp_path)
    hands = Kinematics(robot).hands(robot.comfort)[None]
    record_motion(
        tmp_path / "robot.rrd",
        urdf_text=robot.plain_urdf,
        joint_names=robot.joints,
        times_ns=[0],
        joints=robot.comfort[None],
        targets=hands,
        reached=hands,
        title=name,
    )
    assert (tmp_path / "robot.rrd").stat().st_size > 10_000
    assert "mesh" not in robot.urdf_text


def test_a_log_and_a_controller_need_neither_the_model_nor_its_config(tmp_path: Path) -> None:
    """From the command line, on a folder that is gone after the exploration."""
    folder = write_robot(tmp_path / "mine")
    motion = write_csv(tmp_path / "short.csv", short_motion(load_robot(folder)))
    explored = reenact("explore", "--motion", motion, "--robot", folder, "--out", "short.mcap", "--json", cwd=tmp_path)
    assert explored.returncode == 0, explored.stderr
    shutil.rmtree(folder)
    learned = reenact("train", "short.mcap", "--epochs", 2, "--out", "small.npz", "--json", cwd=tmp_path)
    assert learned.returncode == 0, learned.stderr
    evaluated = reenact("evaluate", "small.npz", "circles", "--json", cwd=tmp_path)
    assert evaluated.returncode == 0, evaluated.stderr
    assert json.loads(evaluated.stdout)["samples"] == 256
    assert evaluate_motion(Controller.load(tmp_path / "small.npz"), tmp_path / "short.mcap").teacher is not None
    with pytest.raises(RobotError, match=r"unknown robot .*: expected one of asimo, .*, ur5, or a directory"):
        load_robot(folder)


def test_a_folder_with_the_urdf_itself_is_the_same_robot(tmp_path: Path) -> None:
    made = load("small", tmp_path)
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "robot.toml").write_text(made.toml_text)
    (tmp_path / "plain" / "robot.urdf").write_text(made.urdf_text)
    plain = load_robot(tmp_path / "plain")
    assert plain.joints == JOINTS
    assert plain.urdf_text == made.urdf_text == parse_robot(made.toml_text, made.urdf_text).urdf_text


def test_the_pages_examples_are_what_the_program_reads() -> None:
    config, pose_hand, source = re.findall(
        r"```toml\n(.*?)```", data_path("robots", "README.md").read_text(), re.DOTALL
    )
    assert parse_source(source).virtual[0].name == "hip_height"
    for text in (config, config.partition("[[hands]]")[0] + pose_hand):
        with pytest.raises(RobotError, match="joints torso_yaw, left_shoulder of the robot config are not movable"):
            parse_robot(text, load_robot("asimo").urdf_text)  # read to the end, and then of another robot


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", IMPORTED)
def test_both_patterns_in_full(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    logs = [
        explore(robot, load_motion(pattern, robot), seed=0, out=tmp_path / f"{pattern}.mcap")
        for pattern in ("circles", "eight")
    ]
    assert [log.teacher_error_cm < bound for log, bound in zip(logs, (1.5, 1.2), strict=True)] == [True, True]
    trainer = train([logs[0].path], schedule=Schedule(epochs=150), config=LearnerConfig(seed=0))
    assert [evaluate_motion(trainer.controller(), log.path).errors.mean_cm < 1.6 for log in logs] == [True, True]


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("name", "bound_cm"), ARMS.items())
def test_arms_explored_for_two_minutes(name: str, bound_cm: float, tmp_path: Path) -> None:
    for command in (
        ("explore", "--robot", name, "--motion", "volume", "--out", "volume.mcap"),
        ("train", "volume.mcap", "--rule", "forward-inverse", "--out", "arm.npz"),
    ):
        run = reenact(*command, cwd=tmp_path)
        assert run.returncode == 0, run.stderr
    controller = Controller.load(tmp_path / "arm.npz")
    found = {motion: evaluate_motion(controller, motion).errors.mean_cm for motion in ("circles", "eight")}
    assert {motion: error_cm for motion, error_cm in found.items() if error_cm > bound_cm} == {}
