"""What `train` prints for people states what its counts are of, and the units of joints; JSON has numbers."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from episodes import write_plain_episode
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.robot.config import load_robot


@pytest.mark.parametrize("logs", [1, 2])
def test_counts_of_a_training_are_those_of_so_many_cycles(tmp_path: Path, logs: int) -> None:
    """A log that is given twice is presented twice in each cycle."""
    log = str(write_plain_episode(tmp_path / "log.mcap", measured=True))
    arguments = ["train", *[log] * logs, "--rule", "forward-inverse", "--out", str(tmp_path / "c.npz"), "--overwrite"]
    lines = CliRunner().invoke(app, arguments).stdout.splitlines()
    found = {name: text.strip() for name, text in (line.split(maxsplit=1) for line in lines)}
    counts = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert found["ticks"] == f"{counts['ticks']}: {11 * logs} in each of 2 cycles"
    assert counts["ticks"] == 22 * logs
    assert found["steps"] == f"{counts['steps']}: {counts['steps'] // 2} in each of 2 cycles"


def test_errors_of_joints_that_were_left_aside_have_units(tmp_path: Path) -> None:
    log = str(write_plain_episode(tmp_path / "log.mcap", samples=30, measured=True))
    arguments = ["train", log, "--rule", "forward-inverse", "--out", str(tmp_path / "c.npz"), "--hold-out", "0.2"]
    printed = CliRunner().invoke(app, arguments).stdout.splitlines()
    aside = json.loads(CliRunner().invoke(app, [*arguments, "--overwrite", "--json"]).stdout)["held_out"]["joints"]
    lines = {line.split()[1]: line for line in printed if line.startswith("held_out_joint ")}
    types = {each.get("name"): each.get("type") for each in ElementTree.fromstring(load_robot("asimo").urdf_text)}
    assert {types[name] for name in aside} == {"revolute", "prismatic"}
    assert lines.keys() == aside.keys()
    for name, line in lines.items():
        assert line.count(" m," if types[name] == "prismatic" else " rad,") == 1
        assert line.endswith(" m" if types[name] == "prismatic" else " rad")
