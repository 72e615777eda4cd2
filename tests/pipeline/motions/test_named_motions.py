"""Motions by name: our own, and one from outside the package, which is explored, learned and tried as ours are."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import toy_motion
from installed import installed
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.cli.options import complete_motion
from pipeline.motions.contract import NamedMotionContract
from pipeline.motions.motion import MOTIONS, load_motion
from pipeline.motions.patterns import circles, eight
from pipeline.robot.config import load_robot
from recorders.errors import ConfigError, MotionError
from recorders.reading.reader import LogReader


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the motion, and one that cannot be loaded."""
    entries = {"lift": "MOTION", "broken": "NONE"}
    with installed(tmp_path_factory.mktemp("site"), toy_motion, MOTIONS, group="reenact.motions", entries=entries):
        yield


class TestLift(NamedMotionContract):
    motion = toy_motion.MOTION


class TestCircles(NamedMotionContract):
    motion = circles.MOTION


class TestEight(NamedMotionContract):
    motion = eight.MOTION


def run(*arguments: object) -> dict[str, Any]:
    found = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert found.exit_code == 0, found.output
    return dict(json.loads(found.stdout))


def test_it_is_explored_learned_and_tried(tmp_path: Path) -> None:
    log, controller = tmp_path / "lift.mcap", tmp_path / "c.npz"
    explored = run("explore", "--motion", "lift", "--out", log)
    assert explored["ticks"] == 8
    assert LogReader(log).manifest["motion"]["name"] == "lift"
    run("train", log, "--epochs", 1, "--out", controller)
    assert run("evaluate", controller, "lift")["samples"] == 7
    assert complete_motion("li") == ["lift"]


def test_a_motion_is_looked_up_and_never_imported_by_name() -> None:
    robot = load_robot("asimo")
    for name in ("toy_motion", "os", "pipeline.motions.motion", "../lift"):
        with pytest.raises(MotionError, match=": expected one of circles, eight, broken, lift, "):
            load_motion(name, robot)
    with pytest.raises(ConfigError, match="motion broken: cannot be loaded"):
        load_motion("broken", robot)
