"""What is no regular file is refused wherever a file can be named: a pipe would be waited for, a device has no end."""

import os
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from small_robot import write_robot

from pipeline.cli import app
from pipeline.learner.controller import Controller
from pipeline.robot.config import load_robot
from recorders.errors import ReenactError, RobotError
from recorders.wire.zenoh_config import read_config


def socket_at(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(path.name)  # names of sockets are short: in the working folder


def link_to_pipe(path: Path) -> None:
    os.mkfifo(path.with_name("far"))
    path.symlink_to(path.with_name("far"))


KINDS: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "socket": socket_at,
    "folder": Path.mkdir,
    "link to a device": lambda path: path.symlink_to("/dev/zero"),
    "link to a pipe": link_to_pipe,
}
FOUND = "found a (directory|pipe, a socket or a device)$"


@pytest.fixture(params=KINDS)
def irregular(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        monkeypatch.chdir(path.parent)
        if path.exists():
            path.unlink()
        KINDS[request.param](path)
        return path

    return make


@pytest.mark.parametrize("file", ["robot.toml", "import.toml", "model.urdf", "robot.urdf"])
def test_of_a_robot(tmp_path: Path, irregular: Callable[[Path], Path], file: str) -> None:
    folder = write_robot(tmp_path / "robot")
    if file == "robot.urdf":
        (folder / "import.toml").unlink()
    irregular(folder / file)
    with pytest.raises(RobotError, match=f"{file}: expected a robot's file, {FOUND}"):
        load_robot(folder)


@pytest.mark.parametrize(
    ("verb", "name", "expected"),
    [
        ("explore --motion {} --out log.mcap", "m.csv", "a CSV file"),
        ("demonstrate {} --out log.mcap", "m.csv", "a CSV file"),
        ("evaluate {} circles", "c.npz", "a controller"),
        ("view {} --save x.rrd", "c.npz", "(a log or a controller|a log, or the parts of a session in a folder)"),
        ("diff {} {}", "c.npz", "a controller"),
        ("golden add any.mcap --config {} --name a --cases .", "c.toml", "a TOML file"),
    ],
)
def test_on_the_command_line(
    tmp_path: Path,
    irregular: Callable[[Path], Path],
    verb: str,
    name: str,
    expected: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = irregular(tmp_path / name)
    with pytest.raises(SystemExit) as ended:
        app.main(verb.replace("{}", str(path)).split())
    assert ended.value.code == 2
    complaint = capsys.readouterr().err
    assert re.search(rf"{name}: expected {expected}.*, found (a|no MCAP file)", complaint), complaint


@pytest.mark.parametrize("read", [Controller.load, read_config])
def test_in_the_library(tmp_path: Path, irregular: Callable[[Path], Path], read: Callable[[Path], object]) -> None:
    with pytest.raises(ReenactError, match=FOUND):
        read(irregular(tmp_path / "file"))
