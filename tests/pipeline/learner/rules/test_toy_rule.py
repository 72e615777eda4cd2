"""A rule from outside the package, registered by an entry point, does all that our own does."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_rule
from episodes import write_plain_episode
from here import reenact_here
from installed import installed
from processes import complaint, reenact, start, wait_for_line
from rerun_server import rerun_server

from pipeline.evaluation.errors import predicted_joints
from pipeline.learner.contract import LearningRuleContract
from pipeline.learner.controller import Controller
from pipeline.learner.registry import RULES, config_from_dict, rule_names
from pipeline.samples.pairs import read_samples
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train_on
from pipeline.views.learning import LearningView, ViewedTrainer
from pipeline.views.live import LiveView
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, ControllerError
from recorders.messages.message_types import JointState
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SAMPLES = 8
EPOCHS = 2


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the rule, and one that cannot be loaded, here and for the processes that are started."""
    site, entries = tmp_path_factory.mktemp("site"), {"toy": "RULE", "broken": "NONE"}
    with (
        installed(site, toy_rule, RULES, group="reenact.rules", entries=entries),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("PYTHONPATH", os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])]))
        yield


class TestToy(LearningRuleContract):
    rule = toy_rule.RULE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, and what the rule made of it from the file."""
    folder = tmp_path_factory.mktemp("toy")
    write_plain_episode(folder / "log.mcap", samples=SAMPLES)
    trained = run("train", "log.mcap", "--rule", "toy", "--epochs", EPOCHS, "--out", "trained.npz", cwd=folder)
    (folder / "trained.json").write_text(json.dumps(trained))
    return folder


def run(*arguments: object, cwd: Path) -> dict[str, Any]:
    found = reenact_here(*arguments, "--json", cwd=cwd)
    assert found.returncode == 0, found.stderr
    return dict(json.loads(found.stdout))


def test_train_writes_a_controller_that_names_its_rule(folder: Path) -> None:
    controller = Controller.load(folder / "trained.npz")
    trained = json.loads((folder / "trained.json").read_text())
    assert (controller.rule, controller.config) == ("toy", toy_rule.ToyConfig(epochs=EPOCHS))
    assert controller.digest == trained["digest"]
    assert trained["steps"] * (SAMPLES + 1) == trained["ticks"] * SAMPLES > 0
    assert np.abs(controller.state["w"]).max() > 0.0


def test_learning_over_zenoh_ends_where_training_from_the_file_does(folder: Path) -> None:
    endpoint, trained = free_endpoint(), json.loads((folder / "trained.json").read_text())
    options = ("--rule", "toy", "--checkpoint", "kept.npz", "--checkpoint-every", 5, "--out", "learned.npz", "--json")
    with start("learn", "--listen", endpoint, *options, cwd=folder) as learner:
        wait_for_line(learner, "waits for a replay")
        run("replay", "log.mcap", "--epochs", EPOCHS, "--wait", 120, "--connect", endpoint, cwd=folder)
        learned, complaints = learner.communicate(timeout=120)
    assert learner.returncode == 0, complaints
    assert json.loads(learned)["digest"] == trained["digest"]
    assert run("diff", "learned.npz", "trained.npz", cwd=folder) == {"equal": True, "first_divergence": None}
    assert Controller.load(folder / "kept.npz").rule == "toy"


def test_a_golden_case_of_it_holds_and_catches_other_settings(folder: Path) -> None:
    made = run("golden", "add", "log.mcap", "--rule", "toy", "--name", "toy", "--resume-after", 5, cwd=folder)
    assert (made["case"], len(made["digest"])) == (str(Path("golden", "toy")), 64)
    assert run("golden", "check", "golden", cwd=folder)["failed"] == 0
    (folder / "ours.toml").write_text('rule = "toy"\nrate = 0.25\n')
    (folder / "other.toml").write_text("reservoir = 300\n")
    for settings, what in (("ours", "learner setting rate"), ("other", "learner setting rule")):
        found = reenact_here("golden", "check", "golden", "--config", f"{settings}.toml", cwd=folder)
        assert (found.returncode, what in found.stdout) == (1, True), found.stdout


def test_diff_names_the_first_array_or_rule_that_differs(folder: Path) -> None:
    run("train", "log.mcap", "--rule", "toy", "--epochs", EPOCHS + 1, "--out", "longer.npz", cwd=folder)
    run("train", "log.mcap", "--epochs", EPOCHS, "--out", "reservoir.npz", cwd=folder)
    for other, name in (("longer.npz", "config.epochs"), ("reservoir.npz", "config.rule")):
        found = reenact_here("diff", "trained.npz", other, "--json", cwd=folder)
        assert (found.returncode, json.loads(found.stdout)["first_divergence"]["name"]) == (1, name)


def test_it_is_evaluated_and_shown(folder: Path) -> None:
    assert run("evaluate", "trained.npz", "log.mcap", cwd=folder)["mean_cm"] > 0.0
    run("view", "trained.npz", "--save", "trained.rrd", cwd=folder)
    assert (folder / "trained.rrd").stat().st_size > 0


def test_its_learning_is_shown_epoch_by_epoch(folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with rerun_server(tmp_path) as server:
        view = LiveView(server.url)
        trainer = ViewedTrainer(toy_rule.ToyConfig(), view=LearningView(view))
        train_on(Replay([folder / "log.mcap"], Schedule(epochs=EPOCHS)), trainer)
        view.close()
    assert caplog.messages == []  # a view that fails says so, and is no reason for learning to fail
    assert trainer.result()["digest"] == json.loads((folder / "trained.json").read_text())["digest"]


def test_serve_answers_a_replay_of_its_targets(folder: Path) -> None:
    endpoint = free_endpoint()
    with start("serve", "trained.npz", "--listen", endpoint, "--json", cwd=folder) as serving:
        wait_for_line(serving, "serves")
        awaited = ("--await", "controller", "--wait", 120, "--connect", endpoint)
        run("replay", "log.mcap", "--play", "--rate", 5, *awaited, cwd=folder)
        serving.send_signal(signal.SIGTERM)
        summary, complaints = serving.communicate(timeout=120)
    assert json.loads(summary)["accepted"] == SAMPLES + 1, complaints


@pytest.mark.parametrize("learn", [False, True])
def test_a_served_controller_commands_what_it_predicts(folder: Path, learn: bool) -> None:
    controller, samples = Controller.load(folder / "trained.npz"), read_samples(folder / "log.mcap")
    served = ServedController(controller, config=ServingConfig(learn=learn))
    records = [record for record in LogReader(folder / "log.mcap") if record.topic in served.topics]
    commands = [command for record in records if (command := served.take(record)) is not None]
    found = np.array([decode_as(JointState, command.data).position for command in commands])
    expected = predicted_joints(controller.learner(), samples.targets, len(controller.joints))
    first = np.clip(expected, samples.robot.lower, samples.robot.upper)
    assert len(commands) == SAMPLES + 1
    if learn:
        assert found[0].tobytes() == first[0].tobytes()
        assert served.status()["learned_steps"] == SAMPLES
        assert served.controller().digest != controller.digest
    else:
        assert found[: len(first)].tobytes() == first.tobytes()
        assert served.controller().state["w"].tobytes() == controller.state["w"].tobytes()


def test_a_rule_is_looked_up_and_never_imported_by_name(folder: Path, tmp_path: Path) -> None:
    assert {"reservoir", "toy", "broken"} <= set(rule_names())
    (tmp_path / "evil.py").write_text("raise SystemExit('imported')")
    for name in ("evil", "os", "toy_rule", "pipeline.learner.npz", "../toy", ""):
        with pytest.raises(ConfigError, match="expected a learning rule, one of"):
            config_from_dict({"rule": name})
    with pytest.raises(ConfigError, match="learning rule broken: cannot be loaded"):
        config_from_dict({"rule": "broken"})
    with pytest.raises(ConfigError, match="rule to be a text, found 3"):
        config_from_dict({"rule": 3})
    line = complaint(reenact_here("train", folder / "log.mcap", "--rule", "evil", "--out", "c.npz", cwd=tmp_path))
    assert "expected a learning rule, one of " in line


def test_a_controller_of_a_rule_that_is_not_installed_is_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", "")
    line = complaint(reenact("evaluate", "trained.npz", "log.mcap", cwd=folder))
    assert "'toy'" in line
    assert "reservoir" in line


def test_a_state_that_is_not_the_rules_is_refused(folder: Path) -> None:
    controller = Controller.load(folder / "trained.npz")
    with pytest.raises(ControllerError, match="expected state w"):
        Controller(**{**vars(controller), "state": {"w": np.zeros((2, 2)), "epoch": np.zeros(1)}})
