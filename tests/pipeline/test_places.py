"""No verb puts what it writes in the place of a file of another kind, and none begins its work before it knows."""

import shlex
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline import cli
from pipeline.learner_config import LearnerConfig
from pipeline.training import train
from recorders.rerun_recorder import check_place
from replay.schedule import Schedule

WRITERS = [
    "train log.mcap --epochs 1 --out",
    "learn --out",
    "learn --out new.npz --checkpoint",
    "learn --live --robot asimo --out new.npz --record",
    "serve controller.npz --out",
    "serve controller.npz --record",
    "view log.mcap --save",
    "view controller.npz --save",
    "explore --motion eight --out",
    "demonstrate right_hand_house --out",
    "demonstrate live --hand left --topic /a --out",
    "recover log.mcap --out",
]
PLACES = ["log.mcap", "README.md", "folder", "nowhere/new"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a controller, a text, a learner's settings and a folder."""
    folder = tmp_path_factory.mktemp("places")
    log = write_episode(folder / "log.mcap", samples=8)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig()).controller().save(folder / "controller.npz")
    (folder / "README.md").write_text("somebody's work\n")
    (folder / "learner.toml").write_text("reservoir = 20\n")
    (folder / "folder").mkdir()
    return folder


def contents(folder: Path) -> dict[str, bytes | None]:
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.iterdir()}


def refused(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """Return the one line with which a command ends, having checked that it changed nothing."""
    monkeypatch.chdir(folder)
    before = contents(folder)
    with pytest.raises(SystemExit) as end:
        cli.main(shlex.split(line))
    printed = capfd.readouterr()
    assert end.value.code == 2
    assert printed.out == ""
    (complaint,) = printed.err.splitlines()
    assert contents(folder) == before
    return complaint


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("writer", WRITERS)
def test_what_is_there_stays(
    folder: Path, writer: str, place: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused(f"{writer} {place}", folder, monkeypatch, capfd)
    assert complaint.startswith("reenact: ")
    assert place in complaint
    found = {"folder": "expected the name of a file", "nowhere/new": "expected a folder"}
    assert any(words in complaint for words in (found.get(place, "choose another name"), "is the damaged log"))


@pytest.mark.parametrize("place", ["--dir . --name README.md", "--dir README.md --name new"])
def test_a_golden_case_replaces_no_file(
    folder: Path, place: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused(f"golden add log.mcap --config learner.toml {place}", folder, monkeypatch, capfd)
    assert "README.md: expected a folder, found a file" in complaint


def test_a_recording_may_replace_a_recording_and_an_empty_file(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    path.touch()
    for _ in range(2):
        with pytest.raises(SystemExit) as end:
            cli.main(["view", str(folder / "log.mcap"), "--save", str(path), "--json"])
        assert end.value.code == 0
        assert path.stat().st_size > 0
        check_place(path)
