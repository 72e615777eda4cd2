"""Training as info states it is what train does: so many samples of which pairs, or the line that it would end with."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from typer.testing import CliRunner

from pipeline.alignment.align import align_logs
from pipeline.alignment.config import AlignmentConfig
from pipeline.cli.app import app
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.training.trainability import trainability
from pipeline.training.trainer import Trainer, train_on
from recorders.errors import ConfigError, ReenactError
from recorders.messages.message_types import JointState, String, TypedMessage
from recorders.messages.phase import LEARN
from recorders.messages.topics import COMMANDED_TICK, JOINT_STATES, ROBOT_CONFIG, ROBOT_DESCRIPTION
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

AS_IT_IS = AlignmentConfig()
NO_TEXTS: Mapping[str, TypedMessage] = {}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("info") / "log.mcap", samples=12)


def write_joints(path: Path, names: tuple[str, ...], texts: Mapping[str, TypedMessage] = NO_TEXTS) -> Path:
    with LogWriter(path, manifest={"kind": "recording"}) as log:
        for topic, text in texts.items():
            log.write(topic, text, log_time_ns=0)
        for step in range(200):
            state = JointState(step * 10_000_000, names, np.full(len(names), 1e-5 * step))
            log.write(JOINT_STATES, state, log_time_ns=step * 10_000_000)
    return path


@pytest.mark.parametrize("rule", ["reservoir", None])
def test_a_log_of_ours_has_as_many_samples_as_train_learns_from(log: Path, rule: str | None) -> None:
    found = trainability(log, rule=rule, alignment=AS_IT_IS)
    assert (found.possible, found.samples, found.pairs, found.alignment) == (True, 12, "commanded", ())
    assert [note.split(":")[0] for note in found.notes] == ["12 samples are few"]
    trainer = Trainer(LearnerConfig())
    train_on(Replay([log], Schedule(epochs=1, phases=((LEARN, 1),))), trainer)
    assert trainer.result()["steps"] == found.samples


def test_a_log_of_others_is_aligned_for_its_robot(tmp_path: Path) -> None:
    robot = load_robot("asimo")
    path = write_joints(tmp_path / "joints.mcap", (*robot.joints, "gripper"))
    found = trainability(path, rule="forward-inverse", robot=robot, alignment=AS_IT_IS)
    assert (found.reason, found.pairs) == ("", "computed")
    assert found.alignment[0].startswith("joints.mcap: aligned to ")


def test_a_recording_of_what_a_robot_published_of_itself_needs_no_robot(tmp_path: Path) -> None:
    robot = load_robot("asimo")
    texts = {ROBOT_DESCRIPTION: String(robot.urdf_text), ROBOT_CONFIG: String(robot.toml_text)}
    path = write_joints(tmp_path / "live.mcap", robot.joints, texts)
    given = trainability(path, rule="forward-inverse", robot=robot, alignment=AS_IT_IS)
    assert trainability(path, rule="forward-inverse", alignment=AS_IT_IS) == given
    assert given.possible


def test_a_description_alone_makes_no_robot(tmp_path: Path) -> None:
    robot = load_robot("asimo")
    path = write_joints(tmp_path / "joints.mcap", robot.joints, {ROBOT_DESCRIPTION: String(robot.urdf_text)})
    with pytest.raises(ConfigError, match=r"carries no robot, .*--robot; /robot_description is a URDF, of which"):
        align_logs([path], AS_IT_IS, robot=None, renames={}, tick=COMMANDED_TICK)


@pytest.mark.parametrize(
    ("names", "robot", "expected"),
    [(("other",), "asimo", "no, because "), (("other",), None, "not looked at: the log carries no robot")],
)
def test_what_stands_in_the_way_is_named(
    tmp_path: Path, names: tuple[str, ...], robot: str | None, expected: str
) -> None:
    path = write_joints(tmp_path / "joints.mcap", names)
    config = None if robot is None else load_robot(robot)
    found = trainability(path, rule="forward-inverse", robot=config, alignment=AS_IT_IS)
    assert not found.possible
    assert found.text().startswith(expected)


def test_info_shows_it(log: Path) -> None:
    result = CliRunner().invoke(app, ["info", str(log)])
    assert result.exit_code == 0
    assert "can be trained: yes, with 12 samples, pairs commanded" in result.stdout
    shown = json.loads(CliRunner().invoke(app, ["info", str(log), "--json"]).stdout)
    assert shown["training"]["possible"] is True
    assert shown["training"]["samples"] == 12


def test_where_the_usual_rule_learns_nothing_another_one_that_does_is_named(tmp_path: Path) -> None:
    robot = load_robot("asimo")
    path = write_joints(tmp_path / "joints.mcap", robot.joints)
    found = trainability(path, robot=robot, alignment=AS_IT_IS)
    expected = trainability(path, rule="forward-inverse", robot=robot, alignment=AS_IT_IS)
    assert (found.rule, found.samples, found.pairs) == ("forward-inverse", expected.samples, "computed")
    assert found.text().startswith(f"yes, with --rule forward-inverse: {found.samples} samples, pairs computed; not ")
    assert "/hand/right/target" in found.reason
    asked = trainability(path, rule="reservoir", robot=robot, alignment=AS_IT_IS)
    assert (asked.samples, asked.rule) == (0, "")
    assert asked.reason.endswith("--rule forward-inverse")


def test_a_rule_that_is_none_is_an_error(log: Path) -> None:
    with pytest.raises(ReenactError, match="expected"):
        trainability(log, rule="none", alignment=AS_IT_IS)
