"""Verbs take a session in any container, and come to what they come to with the log."""

import json
from pathlib import Path
from typing import Any

import bags
import pytest
from episodes import write_episode
from processes import start, wait_for_line
from typer.testing import CliRunner

from pipeline.cli import app as cli
from recorders.errors import ReenactError
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from replay.sources.playback import Playback

FORMS = ["bag", "log.bag"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags")
    log = write_episode(folder / "log.mcap", samples=12)
    for name in FORMS:
        bags.as_bag(log, folder / name)
    return folder


def reenact(*words: object, status: int = 0) -> Any:
    run = CliRunner().invoke(cli.app, [*map(str, words), "--json"])
    assert run.exit_code == status, run.output or run.exception
    return json.loads(run.stdout) if run.stdout else run.exception


@pytest.fixture(scope="module")
def trained(folder: Path) -> dict[str, Any]:
    made: dict[str, Any] = reenact("train", folder / "log.mcap", "--epochs", 1, "--out", folder / "c.npz")
    return made


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_trains_to_the_digest_of_the_log(folder: Path, trained: dict[str, Any], form: str) -> None:
    words = ["--epochs", 1, "--robot", "asimo", "--out", folder / f"{form}.npz"]
    made = reenact("train", folder / form, *words)
    assert made["digest"] == trained["digest"]
    expected = reenact("evaluate", folder / "c.npz", folder / "log.mcap")
    found = reenact("evaluate", folder / "c.npz", folder / form)
    assert {key for key in expected if found[key] != expected[key]} <= {"motion"}


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_is_described_shown_and_compared(folder: Path, form: str, tmp_path: Path) -> None:
    found, log = reenact("info", folder / form), reenact("info", folder / "log.mcap")
    for name in ("messages", "first_ns", "last_ns"):
        assert found[name] == log[name]
    assert reenact("diff", folder / form, folder / "log.mcap", "--ignore", "sequence")["equal"]
    shown = reenact("view", folder / form, "--robot", "asimo", "--save", tmp_path / "v.rrd")
    assert shown["samples"] == reenact("view", folder / "log.mcap", "--save", tmp_path / "w.rrd")["samples"]


@pytest.mark.parametrize("form", FORMS)
def test_what_was_converted_is_the_log(folder: Path, trained: dict[str, Any], form: str, tmp_path: Path) -> None:
    reenact("convert", folder / form, "--out", tmp_path / "x.mcap")
    made = reenact("train", tmp_path / "x.mcap", "--epochs", 1, "--robot", "asimo", "--out", tmp_path / "x.npz")
    assert made["digest"] == trained["digest"]


@pytest.mark.parametrize("form", FORMS)
def test_a_demonstration_is_taken_from_a_bag(folder: Path, form: str, tmp_path: Path) -> None:
    words = ["--hand", "left", "--topic", "/hand/left/target", "--on-unreachable", "clip"]
    outs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for name, out in zip((form, "log.mcap"), outs, strict=True):
        reenact("demonstrate", folder / name, *words, "--out", out)
    assert list(LogReader(outs[0])) == list(LogReader(outs[1]))


def test_a_golden_case_of_a_bag_is_that_of_the_log(folder: Path, tmp_path: Path) -> None:
    settings = tmp_path / "learner.toml"
    settings.write_text("reservoir = 30\nseed = 4\n")
    words = ["--config", settings, "--epochs", 1, "--robot", "asimo", "--cases", tmp_path / "golden"]
    names = [*FORMS, "log.mcap"]
    added = [reenact("golden", "add", folder / name, "--name", f"case_{k}", *words) for k, name in enumerate(names)]
    assert len({case["digest"] for case in added}) == 1
    assert [case["name"] for case in reenact("golden", "check", tmp_path / "golden")["cases"]] == [
        f"case_{k}" for k in range(len(names))
    ]


@pytest.mark.parametrize("form", FORMS)
def test_what_is_played_of_a_bag_is_what_is_played_of_the_log(folder: Path, form: str) -> None:
    played, expected = (list(Playback([folder / name]).stream()) for name in (form, "log.mcap"))
    assert [(m.topic, m.type, m.data) for m in played] == [(m.topic, m.type, m.data) for m in expected] != []


def test_a_bag_is_replayed_into_a_learner_with_the_robot_that_is_given(
    folder: Path, trained: dict[str, Any], tmp_path: Path
) -> None:
    """A bag carries none; the learner comes to the digest of training from the log."""
    endpoint = free_endpoint()
    with start("learn", "--listen", endpoint, "--out", tmp_path / "fed.npz", "--json", cwd=tmp_path) as learner:
        wait_for_line(learner, "waits for a replay")
        options = ("--epochs", 1, "--robot", "asimo", "--wait", 120, "--connect", endpoint)
        reenact("replay", folder / "bag", *options)
        fed = json.loads(learner.communicate(timeout=120)[0])
    assert {name: fed[name] for name in ("digest", "ticks")} == {name: trained[name] for name in ("digest", "ticks")}


def test_ticks_that_were_converted_train_as_the_recording_does(folder: Path, tmp_path: Path) -> None:
    words = ["--tick-rate", 7, "--tolerance", 0.3, "--robot", "asimo"]
    made = reenact("train", folder / "bag", *words, "--epochs", 1, "--out", tmp_path / "a.npz")
    converted = reenact("convert", folder / "bag", *words, "--out", tmp_path / "ticks.mcap")
    assert converted["topics"] == dict.fromkeys((LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS), made["ticks"] // 7)
    assert reenact("info", tmp_path / "ticks.mcap")["sound"]
    again = reenact("train", tmp_path / "ticks.mcap", "--epochs", 1, "--out", tmp_path / "b.npz")
    assert (again["digest"], again["stream_digest"]) == (made["digest"], made["stream_digest"])
    whole = (tmp_path / "ticks.mcap").read_bytes()
    reenact("convert", folder / "bag", *words, "--out", tmp_path / "ticks.mcap", "--overwrite")
    assert (tmp_path / "ticks.mcap").read_bytes() == whole


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["bag", "log.bag", "--tick-rate", 7, "--robot", "asimo"], "expected one recording, found 2"),
        (["bag", "--robot", "asimo"], "expected --tick-rate or --ticks-of beside them"),
        (["bag", "--tick-rate", 7], "carries no robot"),
    ],
)
def test_ticks_that_cannot_be_converted_are_one_line(
    folder: Path, tmp_path: Path, words: list[Any], expected: str
) -> None:
    paths = [folder / word if word in FORMS else word for word in words]
    error = reenact("convert", *paths, "--out", tmp_path / "x.mcap", status=1)
    assert isinstance(error, ReenactError)
    assert expected in str(error)
    assert not (tmp_path / "x.mcap").exists()
