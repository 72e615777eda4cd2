"""Every operation of a recording fails, in every way: what was promised is there, and another can be made."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from disk_faults import DiskTask, Promised, Sweep
from stepped_threads import stepped_threads

from recorders.errors import LogError, TakenError
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

TOPIC, TYPE = "/numbered", "std_msgs/msg/String"
MESSAGES = 150
NAME = "log.mcap"


def payload(run: str, number: int) -> bytes:
    return f"{run} {number:6d}".encode() * (1 + number % 40 if number % 50 else 2000)


def read(path: Path) -> list[bytes]:
    """Return what a log holds before it breaks off."""
    found: list[bytes] = []
    try:
        for record in LogReader(path):
            found.append(record.data)  # one by one: the last step may raise
    except LogError:
        pass
    return found


def holds(path: Path, run: str, least: int) -> bool:
    """Whether a log has the first messages of a run, at least so many, and nothing else."""
    found = read(path)
    return len(found) >= least and found == [payload(run, number) for number in range(len(found))]


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
            assert holds(folder / NAME, "again", MESSAGES)
            assert any(holds(path, "left", 1) for path in folder.iterdir())

    def _check_named(self, folder: Path, promised: Promised) -> None:
        """Assert that the log with the name is the old one or the new one, whole."""
        named = folder / NAME
        if not named.exists():
            assert not (self.overwrite or promised.done)
            return
        is_new = holds(named, "new", MESSAGES)
        assert is_new or (self.overwrite and not promised.done and holds(named, "old", MESSAGES))
        assert LogReader(named).manifest["complete"] is True

    def _record(self, folder: Path, run: str, promised: Promised | None = None) -> None:
        promised = promised or Promised()
        with stepped_threads() as threads:
            with LogWriter(folder / NAME, manifest={}, overwrite=self.overwrite, rechunk=self.rechunk) as log:
                for number in range(MESSAGES):
                    log.write(TOPIC, payload(run, number), log_time_ns=number, type_name=TYPE)
                    if number % 40 == 30:
                        threads.step("log flush")
                        log.check()
                        promised.handed = number + 1
                    if number % 80 == 75:
                        threads.step("log sync")
                        log.check()
                        promised.synced = promised.handed
            promised.handed = promised.synced = MESSAGES
            promised.done = True


@pytest.mark.parametrize("rechunk", [False, True])
@pytest.mark.parametrize("overwrite", [False, True])
def test_recording(tmp_path: Path, overwrite: bool, rechunk: bool) -> None:
    Sweep(Recording(overwrite=overwrite, rechunk=rechunk), tmp_path).run()
