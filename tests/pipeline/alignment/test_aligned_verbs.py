"""Every verb that takes recordings takes those of others: they are aligned as training aligns them."""

import json
from pathlib import Path
from typing import Any

import pytest
from lab import MAPPED, MS, holed, recording, run
from processes import start, wait_for_line
from sessions import write_foreign
from typer.testing import CliRunner

from pipeline.alignment.config import AlignmentConfig
from pipeline.cli import app
from pipeline.learner.controller import Controller
from pipeline.serving.config import ServingConfig
from pipeline.serving.input.served_inputs import ServedInputs
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.served_controller import ServedController
from recorders.wire.loopback import free_endpoint


def test_a_controller_is_tried_on_such_a_log(
    log: Path, robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hands as measured are what it is asked for, where there are no targets."""
    trained(log, *MAPPED)
    assert run("evaluate", tmp_path / "out.npz", log, *MAPPED, "--json") == 0
    shown = capsys.readouterr()
    assert "aligned to 240 ticks at the stamps of /tracker" in shown.err
    result = json.loads(shown.out)
    assert result["samples"] == 240
    assert result["teacher_cm"] < 0.01  # the joints that were measured put the hand where the tracker saw it
    assert result["mean_cm"] < 0.5
    assert run("evaluate", tmp_path / "out.npz", "circles", "--linear-from", log, *MAPPED, "--json") == 0
    assert json.loads(capsys.readouterr().out)["linear_cm"] > 0.0
    ours = tmp_path / "ours.mcap"
    options = ("--rule", "forward-inverse", "--tick-rate", 30, "--robot", robot, "--out", ours)
    assert run("convert", log, *MAPPED, *options, "--json") == 0
    capsys.readouterr()
    assert run("evaluate", tmp_path / "out.npz", log, *MAPPED, "--linear-from", ours, "--json") == 0
    assert json.loads(capsys.readouterr().out)["linear_cm"] > 0.0


def test_where_nothing_is_aligned_its_options_are_refused(
    log: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trained(log, *MAPPED)
    write_foreign(tmp_path / "ours.mcap", [])
    for options, line in (
        (("--tick-rate", "10"), "circles: expected none of --tick-rate"),
        (MAPPED, "circles: expected no --map beside it"),
        (("--deploy", *MAPPED), "--deploy: expected no --map beside it"),
        (("--deploy", "--own-time", "--frame", "/x=0,0,0,0,0,0,1"), "--deploy: expected none of --tick-rate"),
        ((*MAPPED, "--linear-from", tmp_path / "ours.mcap"), "expected a topic /tracker, found none"),
    ):
        assert run("evaluate", tmp_path / "out.npz", "circles", *options) == 2
        assert line in capsys.readouterr().err


def test_names_of_a_projects_settings_are_none_of_a_motions(
    log: Path, trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained(log, *MAPPED)
    (tmp_path / "reenact.toml").write_text(f'map = ["{MAPPED[1]}"]\n')
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app.app, ["evaluate", "out.npz", "circles", "--json"])
    assert result.exit_code == 0, result.exception


def test_a_golden_case_has_the_ticks(
    robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each episode as a log of its own, which come to the digest of training."""
    log = holed(robot, tmp_path / "holed.mcap")
    result, _, _ = trained(log, *MAPPED)
    options = ("--robot", robot, "--rule", "forward-inverse", "--epochs", 1, *MAPPED, "--cases", tmp_path / "golden")
    assert run("golden", "add", log, *options, "--name", "lab", "--json") == 0
    assert json.loads(capsys.readouterr().out)["digest"] == result["digest"]
    assert {path.name for path in (tmp_path / "golden" / "lab").glob("*.mcap")} == {"holed.mcap", "holed_1.mcap"}
    assert run("golden", "check", tmp_path / "golden") == 0


def test_a_replay_presents_the_ticks(robot: Path, trained: Any, tmp_path: Path) -> None:
    """A learner that is fed them comes to the digests of training."""
    log = holed(robot, tmp_path / "holed.mcap")
    result, _, _ = trained(log, *MAPPED)
    endpoint, out = free_endpoint(), tmp_path / "fed.npz"
    arguments = ("--listen", endpoint, "--rule", "forward-inverse", "--out", out, "--json")
    with start("learn", *arguments, cwd=tmp_path) as learner:
        wait_for_line(learner, "waits for a replay")
        options = ("--rule", "forward-inverse", "--epochs", 1, "--robot", robot, *MAPPED, "--connect", endpoint)
        assert run("replay", log, *options, "--wait", 120, "--json") == 0
        fed = json.loads(learner.communicate(timeout=120)[0])
    assert {name: fed[name] for name in ("digest", "stream_digest", "ticks")} == {
        name: result[name] for name in ("digest", "stream_digest", "ticks")
    }
    assert Controller.load(out).provenance["logs"][0]["alignment"]["episodes"] == 2


def test_live_learning_aligns_as_training_does(
    robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Messages of a lab as they come, by the lab's names: the digest of `train --as-live`."""
    log = holed(robot, tmp_path / "holed.mcap")
    options = (*MAPPED, "--tick-rate", 20)
    result, _, _ = trained(log, *options, "--as-live")
    endpoint, out = free_endpoint(), tmp_path / "live.npz"
    arguments = ("--listen", endpoint, "--robot", robot, "--rule", "forward-inverse", "--out", out, "--json")
    with start("learn", "--live", *arguments, *options, cwd=tmp_path) as learner:
        wait_for_line(learner, "learns more")
        assert run("replay", log, "--play", "--await", "learner", "--wait", 120, "--connect", endpoint) == 0
        live = json.loads(learner.communicate(timeout=120)[0])
    assert {name: live[name] for name in ("digest", "ticks")} == {name: result[name] for name in ("digest", "ticks")}
    assert (live["gaps"], live["missed"], live["aligned"]) == (1, 21, result["ticks"])
    assert Controller.load(out).provenance["logs"][0]["alignment"]["period_ns"] == 50 * MS
    assert run("learn", "--map", "/a=/b", "--out", tmp_path / "x.npz") == 2
    assert "learn without --live, whose replay aligns: expected no --map beside it" in capsys.readouterr().err


def test_a_served_controller_takes_a_labs_topics(log: Path, robot: Path, trained: Any) -> None:
    """Targets by another name are answered at once, and what is learned meanwhile is aligned apart from them."""
    _, _, controller = trained(log, *MAPPED)
    renames = {"/tracker": "/hand/tip/measured", "/teleop": "/hand/tip/target"}
    config = ServeConfig(serving=ServingConfig(learn=True), alignment=AlignmentConfig(), renames=renames)
    served = ServedController(controller, config=config.serving)
    inputs = ServedInputs(controller, config, served.topics)
    assert set(inputs.topics) >= {"/teleop", "/tracker", "/joint_states"}
    recorded = recording(robot)[:300]
    targets = [r._replace(topic="/teleop", log_time_ns=r.log_time_ns + 1) for r in recorded if r.topic == "/tracker"]
    answered = 0
    for record in sorted([*recorded, *targets], key=lambda record: record.log_time_ns):
        commands = [command for taken in inputs.taken(record) if (command := served.take(taken)) is not None]
        assert len(commands) == (record.topic == "/teleop")
        answered += len(commands)
    assert answered == len(targets) > 60
    counts = served.counts()
    assert len(targets) - 2 <= counts["learned_steps"] <= len(targets)
    assert counts["refused"] == inputs.counts["unaligned"] == 0
