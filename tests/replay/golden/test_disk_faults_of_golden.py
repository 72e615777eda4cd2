"""Every operation of `golden add` fails, in every way: the old case or the new one is there, whole."""

from pathlib import Path

import pytest
from counting_runner import CountingRunner
from disk_faults import DiskTask, Promised, fail_once, in_every_way, sweep
from episodes import write_plain_episode
from simulated_disk import Fault
from stepped_threads import stepped_threads

from recorders.errors import ReenactError
from recorders.files import disk
from replay.golden.add import add_case
from replay.golden.case import load_case
from replay.golden.check import check_case
from replay.golden.folder import roll_back
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule

LOG = "log.mcap"


class Adding(DiskTask):
    """A case of a short log, in a new folder or in the place of another one."""

    def __init__(self, *, replaces: bool) -> None:
        self.replaces = replaces

    def prepare(self, folder: Path) -> None:
        write_plain_episode(folder / LOG, samples=3)
        if self.replaces:
            self._add(folder, "old")

    def run(self, folder: Path, promised: Promised) -> None:
        self._add(folder, "new")
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        case = folder / "cases" / "a"
        aside = case.with_name(".a.replaced")
        if not case.exists() and self.replaces:
            assert not promised.done
            case = aside  # the next start puts it back
        if not case.exists():
            assert not promised.done
            return
        assert check_case(case, CountingRunner()).finding is None
        reason = load_case(case).history[-1]["reason"]
        assert reason == "new" or (self.replaces and not promised.done)

    def run_again(self, folder: Path) -> None:
        roll_back(folder / "cases" / "a")
        self._add(folder, "again")
        case = folder / "cases" / "a"
        assert check_case(case, CountingRunner()).finding is None
        assert load_case(case).history[-1]["reason"] == "again"
        assert list(case.parent.iterdir()) == [case]  # what was left of before is gone

    def _add(self, folder: Path, reason: str) -> None:
        with stepped_threads():
            recipe = CaseSpec((folder / LOG,), {}, Schedule(epochs=1))
            add_case(folder / "cases" / "a", recipe, CountingRunner(), reason=reason)


@pytest.mark.parametrize("replaces", [False, True])
@in_every_way(41)
def test_a_case_is_there_whole(tmp_path: Path, step: int, replaces: bool) -> None:
    sweep(Adding(replaces=replaces), tmp_path, step)


def write_unsynced(path: Path, data: bytes) -> None:
    with disk.create(path) as file:
        file.write(data)


def test_a_case_whose_files_are_not_on_the_disk_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So they were written once: after a power failure the new case was there, and its files were empty."""
    monkeypatch.setattr("replay.golden.case.write_whole", write_unsynced)
    with pytest.raises((AssertionError, ReenactError)):
        fail_once(Adding(replaces=False), tmp_path, Fault())
