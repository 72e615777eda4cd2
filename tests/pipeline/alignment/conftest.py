"""A robot of one hand, a lab's recording of it, and training from such recordings."""

import json
from pathlib import Path
from typing import Any

import pytest
from lab import recording, run
from more_hands import ONE, write_robot
from sessions import write_foreign

from pipeline.learner.controller import Controller


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot") / "robot", ONE)


@pytest.fixture(scope="module")
def log(robot: Path) -> Path:
    return write_foreign(robot.parent / "lab.mcap", recording(robot))


@pytest.fixture
def trained(robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Train from a log and return the result, what was noted, and the controller."""

    def train(log: Path, *options: object) -> tuple[Any, str, Controller]:
        out = tmp_path / "out.npz"
        arguments = (
            "--robot",
            robot,
            "--rule",
            "forward-inverse",
            "--epochs",
            1,
            "--out",
            out,
            "--overwrite",
            "--json",
        )
        assert run("train", log, *arguments, *options) == 0
        shown = capsys.readouterr()
        return json.loads(shown.out), shown.err, Controller.load(out)

    return train
