"""No verb replaces a file unless told to, nor ever one of another kind, and none begins its work before it knows."""

import shlex
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.cli import app
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.rerun_scene.recording import check_place
from replay.sources.schedule import Schedule

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
    "convert log.mcap --out",
]
PLACES = ["log.mcap", "README.md", "folder", "nowhere/new"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a controller, a text, a learner's settings and a folder."""
    folder = tmp_path_factory.mktemp("places")
    log = write_episode(folder / "log.mcap", samples=8)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig()).controller().save(folder / "controller.npz")
    (folder / "cut.npz").write_bytes((folder / "controller.npz").read_bytes()[:-100])
    (folder / "cut.mcap").write_bytes(log.read_bytes()[:-100])
    (folder / "view.rrd").write_bytes(b"RRF2")
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
        app.main(shlex.split(line))
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


@pytest.mark.parametrize("place", ["--cases . --name README.md", "--cases README.md --name new"])
def test_a_golden_case_replaces_no_file(
    folder: Path, place: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused(f"golden add log.mcap --config learner.toml {place}", folder, monkeypatch, capfd)
    assert "README.md: expected a folder, found a file" in complaint


@pytest.mark.parametrize(
    ("writer", "place"),
    [
        ("train log.mcap --epochs 1 --out", "controller.npz"),
        ("learn --out", "controller.npz"),
        ("learn --live --robot asimo --out", "controller.npz"),
        ("learn --live --robot asimo --out new.npz --record", "log.mcap"),
        ("serve controller.npz --learn --out", "controller.npz"),
        ("serve controller.npz --record", "log.mcap"),
        ("view log.mcap --save", "view.rrd"),
        ("view controller.npz --save", "view.rrd"),
        ("explore --motion eight --out", "log.mcap"),
        ("demonstrate right_hand_house --out", "log.mcap"),
        ("record --out", "log.mcap"),
        ("recover cut.mcap --out", "log.mcap"),
    ],
)
def test_what_is_there_of_the_same_kind_is_replaced_only_if_told_to(
    folder: Path, writer: str, place: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused(f"{writer} {place}", folder, monkeypatch, capfd)
    assert complaint == f"reenact: {place} exists: choose another name, or replace it with --overwrite"


def test_told_to_it_replaces(folder: Path, tmp_path: Path) -> None:
    before = (folder / "controller.npz").read_bytes()
    path = tmp_path / "learned.npz"
    path.write_bytes(before)
    with pytest.raises(SystemExit) as end:
        app.main(["train", str(folder / "log.mcap"), "--epochs", "1", "--seed", "3", "--out", str(path), "--overwrite"])
    assert end.value.code == 0
    assert path.read_bytes() != before


def test_what_is_no_checkpoint_is_refused_before_anybody_is_waited_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused("learn --out new.npz --checkpoint controller.npz", folder, monkeypatch, capfd)
    assert "controller.npz: expected a checkpoint of a learner, found a controller without one" in complaint
    complaint = refused("learn --out new.npz --checkpoint cut.npz", folder, monkeypatch, capfd)
    assert "cut.npz: there is a file that is no controller, which stays as it is" in complaint


def test_a_recording_may_replace_an_empty_file_and_if_told_to_a_recording(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    path.touch()
    for options in ((), ("--overwrite",)):
        with pytest.raises(SystemExit) as end:
            app.main(["view", str(folder / "log.mcap"), "--save", str(path), "--json", *options])
        assert end.value.code == 0
        assert path.stat().st_size > 0
        check_place(path)
