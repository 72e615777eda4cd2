"""Every operation of a recording fails, in every way: what was promised is there, and another can be made."""

from pathlib import Path

import pytest
from disk_faults import DiskTask, Promised, fail_once, in_every_way, sweep
from log_content import TOPIC, TYPE, holds, is_whole, payload
from simulated_disk import Fault
from stepped_threads import stepped_threads

from recorders.errors import TakenError
from recorders.files import disk
from recorders.files.anonymous_file import AnonymousFile
from recorders.writing.writer import LogWriter

MESSAGES = 80
NAME = "log.mcap"


class Recording(DiskTask):
    """A log of some messages, which are handed over and synced now and then."""

    def __init__(self, *, overwrite: bool, rechunk: bool) -> None:
        self.overwrite, self.rechunk = overwrite, rechunk

    def prepare(self, folder: Path) -> None:
        if self.overwrite:
            self._record(folder, "old")
        with stepped_threads():
            left = LogWriter(folder / NAME, manifest={}, overwrite=True)
            left.write(TOPIC, payload("left", 0), log_time_ns=0, type_name=TYPE)
            left.abort()

    def run(self, folder: Path, promised: Promised) -> None:
        self._record(folder, "new", promised)

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        logs = [path for path in folder.iterdir() if path.name.startswith(NAME)]
        assert any(holds(path, "left", 1) for path in logs)
        assert promised.least(outcome) == 0 or any(holds(path, "new", promised.least(outcome)) for path in logs)
        self._check_named(folder, promised)

    def run_again(self, folder: Path) -> None:
        taken = (folder / NAME).exists()
        try:
            self._record(folder, "again")
        except TakenError:
            assert taken
            assert not self.overwrite
        else:
            assert is_whole(folder / NAME, "again", MESSAGES)
            assert any(holds(path, "left", 1) for path in folder.iterdir())

    def _check_named(self, folder: Path, promised: Promised) -> None:
        """Assert that the log with the name is the old one or the new one, whole."""
        named = folder / NAME
        if not named.exists():
            assert not self.overwrite
            assert not promised.done
            return
        is_old = self.overwrite and not promised.done and is_whole(named, "old", MESSAGES)
        assert is_old or is_whole(named, "new", MESSAGES)

    def _record(self, folder: Path, run: str, promised: Promised | None = None) -> None:
        promised = promised or Promised()
        with stepped_threads() as threads:
            with LogWriter(folder / NAME, manifest={}, overwrite=self.overwrite, rechunk=self.rechunk) as log:
                for number in range(MESSAGES):
                    log.write(TOPIC, payload(run, number), log_time_ns=number, type_name=TYPE)
                    if number % 32 == 20:
                        threads.step("log flush")
                        threads.step("log flush")
                        log.check()
                        promised.handed = number + 1
                    if number == 60:
                        threads.step("log sync")
                        log.check()
                        promised.synced = promised.handed
            promised.handed = promised.synced = MESSAGES
            promised.done = True


@pytest.mark.parametrize("rechunk", [False, True])
@pytest.mark.parametrize("overwrite", [False, True])
@in_every_way(11)
def test_what_a_recording_was_promised_is_there(tmp_path: Path, step: int, overwrite: bool, rechunk: bool) -> None:
    sweep(Recording(overwrite=overwrite, rechunk=rechunk), tmp_path, step)


def replace_unsynced(self: AnonymousFile) -> None:
    self.stream.flush()
    self._name = self._name or self._link()
    disk.rename(self._name, self._near)
    self._name = None


def move_unsynced(old: Path, new: Path) -> None:
    disk.link(old, new)
    disk.unlink(old)


@pytest.mark.parametrize(
    ("name", "as_it_was", "task", "fault"),
    [
        # Between the copy in the log's place and its sync nothing of the recording was on the disk.
        (
            "recorders.files.anonymous_file.AnonymousFile.replace",
            replace_unsynced,
            Recording(overwrite=True, rechunk=True),
            Fault(42, "crash before"),
        ),
        # The old name went before the disk had the new one: at the end, and when the rest of a crash is set aside.
        (
            "recorders.writing.part_file._move",
            move_unsynced,
            Recording(overwrite=False, rechunk=False),
            Fault(24, "crash after"),
        ),
        (
            "recorders.writing.part_file._move",
            move_unsynced,
            Recording(overwrite=True, rechunk=False),
            Fault(6, "EIO"),
        ),
    ],
)
def test_what_was_found_once_is_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, as_it_was: object, task: Recording, fault: Fault
) -> None:
    (tmp_path / "now").mkdir()
    fail_once(task, tmp_path / "now", fault)
    monkeypatch.setattr(name, as_it_was)
    with pytest.raises(AssertionError):
        fail_once(task, tmp_path, fault)
