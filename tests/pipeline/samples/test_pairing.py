"""Pairing rules: commanded, reached, and one from outside the package, through all that takes ticks."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_pairs
from episodes import write_plain_episode
from installed import installed
from processes import reenact, start, wait_for_line
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.golden.own_settings import Own
from pipeline.golden.runner import GoldenRunner, recipe
from pipeline.learner.controller import Controller
from pipeline.learner.controller_diff import first_difference
from pipeline.learner.registry import default_config
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.contract import PairingRuleContract
from pipeline.samples.pairing import PAIRING_RULES, find_pairing
from pipeline.samples.pairs import read_samples
from pipeline.samples.rules import commanded, computed, reached
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.training.checkpoints import CheckpointConfig
from pipeline.training.trainer import Trainer, train_on
from recorders.errors import ConfigError, ControllerError, LogError, WireError
from recorders.messages.record import RecordedMessage
from recorders.wire.loopback import free_endpoint
from replay.golden.add import add_case
from replay.golden.check import check_case
from replay.sources.live import LiveLog
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SAMPLES, EPOCHS = 8, 2
SAME = ("digest", "stream_digest", "steps", "ticks")


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the rule, and one that cannot be loaded."""
    entries = {"toy": "RULE", "broken": "NONE"}
    with installed(tmp_path_factory.mktemp("site"), toy_pairs, PAIRING_RULES, group="reenact.pairs", entries=entries):
        yield


class TestCommanded(PairingRuleContract):
    rule = commanded.RULE


class TestReached(PairingRuleContract):
    rule = reached.RULE


class TestComputed(PairingRuleContract):
    rule = computed.RULE


class TestToy(PairingRuleContract):
    rule = toy_pairs.RULE


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_plain_episode(tmp_path_factory.mktemp("pairs") / "log.mcap", samples=SAMPLES, measured=True)


def run(*arguments: object) -> dict[str, Any]:
    found = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert found.exit_code == 0, found.output
    return dict(json.loads(found.stdout))


def trained(log: Path, pairs: str) -> Trainer:
    topics = find_pairing(pairs).topics(("left", "right"))
    return train_on(Replay([log], Schedule(EPOCHS, topics=topics)), Trainer(default_config(), pairs=pairs))


def cut(replay: Replay, end: int) -> Iterator[RecordedMessage]:
    yield from islice(replay.stream(), end)
    raise WireError("killed")


@pytest.mark.parametrize(
    ("pairs", "steps"), [("commanded", SAMPLES), *((name, SAMPLES + 1) for name in ("reached", "computed", "toy"))]
)
def test_a_kill_and_messages_one_by_one_end_where_training_in_memory_does(
    pairs: str, steps: int, log: Path, tmp_path: Path
) -> None:
    whole = trained(log, pairs).result()
    assert (whole["ticks"], whole["steps"]) == (7 * EPOCHS * (SAMPLES + 1), 7 * EPOCHS * steps)
    source = Replay([log], Schedule(EPOCHS, topics=find_pairing(pairs).topics(("left", "right"))))
    checkpoint = CheckpointConfig(tmp_path / "kept.npz", 1)
    first = Trainer(default_config(), pairs=pairs, checkpoint=checkpoint)
    first.hello(source.offer())
    with pytest.raises(WireError, match="killed"):
        first.consume(cut(source, 100))
    other = next(name for name in ("commanded", "reached") if name != pairs)
    with pytest.raises((ConfigError, ControllerError), match=f"pairs ({other}|computed)"):
        Trainer(default_config(), pairs=other, checkpoint=checkpoint).hello(source.offer())
    second = Trainer(default_config(), pairs=pairs, checkpoint=checkpoint)
    start = second.hello(source.offer())
    assert 60 < start <= 100
    assert second.consume(source.stream(start)) == whole
    assert Controller.load(tmp_path / "kept.npz").pairs == pairs


def test_reached_pairs_are_hands_and_joints_of_one_instant(log: Path) -> None:
    asked, found = read_samples(log), read_samples(log, pairs="reached")
    waves = np.array([(tick % 8 - 4) * 0.015625 for tick in range(SAMPLES + 1)])
    rows = [[0.25, 0.25 + wave * 0.75, 0.75, 0.25, -0.25, 0.75 - wave * 0.75] for wave in waves]
    assert found.targets.tolist() == rows
    assert found.joints.tolist() == (found.robot.comfort + waves[:, np.newaxis] * 0.5).tolist()
    assert len(asked.targets) == SAMPLES
    assert asked.joints.tolist() == found.joints[1:].tolist()


def test_where_no_hands_are_measured_the_robots_kinematics_has_them(log: Path, tmp_path: Path) -> None:
    bare = write_plain_episode(tmp_path / "bare.mcap", samples=SAMPLES)
    found = read_samples(bare, pairs="computed")
    hands = Kinematics(found.robot).hands_along(found.joints)
    np.testing.assert_allclose(found.targets, hands.reshape(SAMPLES + 1, -1), rtol=0, atol=1e-14)
    expected = trained(bare, "computed").result()
    for logs, digest in (((bare,), expected["digest"]), ((log, bare), None)):
        options = ("--pairs", "reached", "--epochs", EPOCHS, "--out", tmp_path / "c.npz", "--overwrite")
        result = run("train", *logs, *options)
        assert (result["pairs"], result["digest"]) == ("computed", digest or result["digest"])
        assert Controller.load(tmp_path / "c.npz").pairs == "computed"
        assert run("evaluate", tmp_path / "c.npz", bare)["pairs"] == "computed"
    (tmp_path / "ours.toml").write_text('reservoir = 12\npairs = "reached"\n')
    made = recipe([bare], tmp_path / "ours.toml", epochs=1)
    assert (made.learner["pairs"], made.schedule.topics) == ("computed", ("/sample/joint_states",))
    assert Own(config=tmp_path / "ours.toml").difference(made) is None
    assert check_case(add_case(tmp_path / "case", made, GoldenRunner()).folder, GoldenRunner()).finding is None


def learned_live(log: Path, folder: Path, endpoint: str) -> dict[str, Any]:
    """Learn live from a log that is played, recording it as live.mcap."""
    live = ("learn", "--live", "--pairs", "reached", "--robot", "asimo", "--ticks", SAMPLES, "--record", "live.mcap")
    with start(*live, "--listen", endpoint, "--out", "live.npz", "--json", cwd=folder) as learner:
        wait_for_line(learner, "learns asimo")
        played = reenact("replay", log, "--play", "--connect", endpoint, "--json", cwd=folder)
        assert played.returncode == 0, played.stderr
        learned, complaints = learner.communicate(timeout=60)
    assert learner.returncode == 0, complaints
    result = json.loads(learned)
    assert (result["ticks"], result["steps"], result["gaps"], result["dropped"]) == (SAMPLES, SAMPLES, 0, 0)
    return dict(result)


def test_live_over_zenoh_recorded_and_from_the_file_are_one_state(log: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    result = learned_live(log, tmp_path, endpoint)
    replayed = ("learn", "--pairs", "reached", "--listen", endpoint, "--out", "again.npz", "--json")
    with start(*replayed, cwd=tmp_path) as learner:
        wait_for_line(learner, "waits for a replay")
        arguments = ("--as-recorded", "--wait", 120, "--connect", endpoint, "--json")
        sent = reenact("replay", "live.mcap", *arguments, cwd=tmp_path)
        assert sent.returncode == 0, sent.stderr
        again, complaints = learner.communicate(timeout=60)
    assert learner.returncode == 0, complaints
    trained = run("train", tmp_path / "live.mcap", "--as-recorded", "--pairs", "reached", "--out", tmp_path / "c.npz")
    for key in SAME:
        assert result[key] == json.loads(again)[key] == trained[key], key
    controllers = [Controller.load(tmp_path / name) for name in ("live.npz", "again.npz", "c.npz")]
    assert {controller.pairs for controller in controllers} == {"reached"}
    assert all(first_difference(controllers[0], other) is None for other in controllers[1:])


def test_live_without_measured_hands_and_from_the_recording_are_one_state(tmp_path: Path) -> None:
    bare = write_plain_episode(tmp_path / "bare.mcap", samples=SAMPLES)
    result = learned_live(bare, tmp_path, free_endpoint())
    trained = run("train", tmp_path / "live.mcap", "--as-recorded", "--pairs", "reached", "--out", tmp_path / "c.npz")
    assert [trained[key] for key in (*SAME, "pairs")] == [result[key] for key in (*SAME, "pairs")]
    assert result["pairs"] == "computed"
    assert first_difference(*(Controller.load(tmp_path / name) for name in ("live.npz", "c.npz"))) is None


def test_a_learner_refuses_a_stream_without_its_topics(log: Path) -> None:
    topics = find_pairing("reached").topics(("left", "right"))
    with pytest.raises(ConfigError, match="pairs commanded: expected a stream with /hand/left/target"):
        Trainer(default_config()).hello(Replay([log], Schedule(EPOCHS, topics=topics)).offer())
    bare = write_plain_episode(log.with_name("bare.mcap"))
    with pytest.raises(LogError, match="expected messages on /hand/left/measured, /hand/right/measured, found none"):
        trained(bare, "reached")


def test_a_log_as_live_is_joined_by_the_same_topics(log: Path) -> None:
    topics = find_pairing("reached").topics(("left", "right"))
    live = train_on(LiveLog(log, tick=topics), Trainer(default_config(), pairs="reached"))
    assert live.result()["steps"] == SAMPLES + 1


@pytest.mark.parametrize("pairs", ["reached", "computed", "toy"])
def test_verbs_take_pairs_and_evaluate_reports_them(pairs: str, log: Path, tmp_path: Path) -> None:
    result = run("train", log, "--pairs", pairs, "--epochs", EPOCHS, "--out", tmp_path / "c.npz")
    assert result["digest"] == trained(log, pairs).result()["digest"]
    run("train", log, "--epochs", EPOCHS, "--out", tmp_path / "usual.npz")
    assert run("evaluate", tmp_path / "c.npz", log)["pairs"] == pairs
    assert run("evaluate", tmp_path / "usual.npz", log)["pairs"] == "commanded"
    one, other = (Controller.load(tmp_path / name) for name in ("c.npz", "usual.npz"))
    difference = first_difference(one, other)
    assert difference is not None
    assert (difference.name, difference.a, difference.b) == ("pairs", pairs, "commanded")
    with pytest.raises(ConfigError, match=f"pairs commanded, or .* found one of {pairs}"):
        ServedController(one, config=ServingConfig(learn=True))


@pytest.mark.parametrize("pairs", ["reached", "computed", "toy"])
def test_a_golden_case_keeps_its_pairs_and_their_topics(pairs: str, log: Path, tmp_path: Path) -> None:
    (tmp_path / "ours.toml").write_text("reservoir = 12\n")
    made = recipe([log], tmp_path / "ours.toml", pairs=pairs, epochs=1, resume_after=5)
    case = add_case(tmp_path / "case", made, GoldenRunner())
    assert case.recipe.learner["pairs"] == pairs
    assert check_case(case.folder, GoldenRunner()).finding is None
    assert recipe([], None, old=case.recipe, epochs=2).learner["pairs"] == pairs
    changed = Own(config=tmp_path / "ours.toml").difference(case.recipe)
    assert changed is not None
    assert changed[0] == "learner setting pairs"


def test_a_rule_is_looked_up_and_never_imported_by_name() -> None:
    assert {"commanded", "reached", "toy", "broken"} <= set(PAIRING_RULES.names())
    for name in ("evil", "os", "toy_pairs", "pipeline.samples.pairs", "../toy", ""):
        with pytest.raises(ConfigError, match="expected a pairing rule, one of commanded, computed, reached"):
            find_pairing(name)
    with pytest.raises(ConfigError, match="pairing rule broken: cannot be loaded"):
        find_pairing("broken")
