"""A verb that writes files, on a disk that fails: one line that names the place, status 2, nothing half by its name."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from episodes import write_episode
from simulated_disk import Fault, SimulatedDisk

from pipeline.cli import app
from pipeline.learner.controller import Controller
from recorders.reading.reader import LogReader

KINDS = ("EIO", "ENOSPC", "EROFS")


def is_log(path: Path) -> bool:
    return LogReader(path).manifest["messages"] == len(list(LogReader(path)))


def is_folder(path: Path) -> bool:
    return len(list(path.iterdir())) >= 3 and all(table.read_bytes().endswith(b"\n") for table in path.iterdir())


def is_controller(path: Path) -> bool:
    return bool(Controller.load(path).digest)


VERBS: dict[str, tuple[list[str], str, Callable[[Path], bool]]] = {
    "convert": (["convert", "log.mcap", "--out", "out.mcap"], "out.mcap", is_log),
    "recover": (["recover", "cut.mcap", "--out", "out.mcap"], "out.mcap", is_log),
    "export": (["export", "log.mcap", "--out", "tables"], "tables", is_folder),
    "train": (["train", "log.mcap", "--epochs", "1", "--out", "out.npz"], "out.npz", is_controller),
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs") / "logs"
    folder.mkdir()
    raw = write_episode(folder / "log.mcap", samples=12).read_bytes()
    (folder / "cut.mcap").write_bytes(raw[: len(raw) * 3 // 4])
    return folder


@pytest.mark.parametrize("verb", VERBS)
def test_a_disk_that_fails_is_one_line(
    logs: Path, verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, out, is_whole = VERBS[verb]

    def run(fault: Fault) -> tuple[SimulatedDisk, int, list[str]]:
        """Run the verb and return its disk, its status and its lines on standard error."""
        folder = shutil.copytree(logs, tmp_path / "disk")
        monkeypatch.chdir(folder)
        disk = SimulatedDisk(folder, fault)
        with disk.installed(), pytest.raises(SystemExit) as ended:
            app.main(arguments)
        disk.journal.check()
        assert not (folder / out).exists() or is_whole(folder / out)
        assert (folder / out).exists() or ended.value.code != 0
        shutil.rmtree(folder)
        return disk, int(str(ended.value.code)), capsys.readouterr().err.splitlines()

    sound, status, _ = run(Fault())
    assert status == 0
    for count, number in enumerate(range(0, len(sound.operations), 1 + len(sound.operations) // 7)):
        disk, status, lines = run(Fault(number, KINDS[count % len(KINDS)]))
        where = f"{disk.operations[number]}, {number}: {lines}"
        assert status in (0, 2), where
        assert status == 0 or (lines and out in lines[-1] and lines[-1].startswith("reenact: ")), where
        assert not any("Traceback" in line for line in lines), where
