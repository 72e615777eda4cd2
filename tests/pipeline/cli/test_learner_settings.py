"""Settings of a learner are in one file for every verb that learns: a golden case comes to the digest of training."""

import json
from pathlib import Path
from typing import Any

import pytest
from episodes import write_plain_episode
from typer.testing import CliRunner

from pipeline.cli import app as cli
from recorders.errors import ConfigError


def reenact(*words: object) -> Any:
    run = CliRunner().invoke(cli.app, [*map(str, words), "--json"])
    assert run.exit_code == 0, run.exception or run.output
    return json.loads(run.stdout)


def test_a_file_of_settings_is_that_of_training_and_of_a_case(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=6)
    file = tmp_path / "learner.toml"
    file.write_text('rule = "reservoir"\nreservoir = 12\nseed = 4\n')
    trained = reenact("train", log, "--config", file, "--epochs", 1, "--out", tmp_path / "a.npz")
    case = reenact("golden", "add", log, "--config", file, "--epochs", 1, "--name", "one", "--cases", tmp_path / "g")
    assert trained["digest"] == case["digest"]
    plain = reenact("train", log, "--seed", 4, "--epochs", 1, "--out", tmp_path / "b.npz")
    assert plain["digest"] != trained["digest"]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--rule", "forward-inverse"), "expected the rule that"),
        (("--seed", "3"), "--seed: expected none beside --config"),
    ],
)
def test_an_option_that_differs_from_the_file_is_refused(tmp_path: Path, options: tuple[str, ...], line: str) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=6)
    (tmp_path / "learner.toml").write_text('rule = "reservoir"\nseed = 4\n')
    words = ["train", str(log), "--config", str(tmp_path / "learner.toml"), "--out", str(tmp_path / "a.npz"), *options]
    run = CliRunner().invoke(cli.app, words)
    assert isinstance(run.exception, ConfigError)
    assert line in str(run.exception)
