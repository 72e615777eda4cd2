"""Every operation of a conversion fails, in every way: there is a whole log, that of before, or none."""

from pathlib import Path

import pytest
from disk_faults import DiskTask, Promised, fail_once, in_every_way, sweep
from log_content import TOPIC, TYPE, data_of, is_whole, payload
from simulated_disk import Fault, SimulatedDisk
from stepped_threads import stepped_threads

from recorders.conversion.config import ConvertConfig
from recorders.conversion.convert import convert
from recorders.errors import LogError
from recorders.files import disk
from recorders.writing.writer import LogWriter

MESSAGES = 70
SOURCE, OUT = "source.mcap", "out.mcap"


def write(path: Path, run: str) -> None:
    with stepped_threads(), LogWriter(path, manifest={}) as log:
        for number in range(MESSAGES):
            log.write(TOPIC, payload(run, number), log_time_ns=number, type_name=TYPE)


class Converting(DiskTask):
    """A recording that is converted, perhaps in the place of another one."""

    def __init__(self, *, overwrite: bool) -> None:
        self.overwrite = overwrite

    def prepare(self, folder: Path) -> None:
        write(folder / SOURCE, "new")
        if self.overwrite:
            write(folder / OUT, "old")

    def run(self, folder: Path, promised: Promised) -> None:
        convert([folder / SOURCE], folder / OUT, overwrite=self.overwrite)
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        assert is_whole(folder / SOURCE, "new", MESSAGES)
        out = folder / OUT
        if not out.exists():
            assert not self.overwrite
            assert not promised.done
            return
        is_old = self.overwrite and not promised.done and is_whole(out, "old", MESSAGES)
        assert is_old or is_whole(out, "new", MESSAGES)

    def run_again(self, folder: Path) -> None:
        convert([folder / SOURCE], folder / OUT, overwrite=True)
        assert is_whole(folder / OUT, "new", MESSAGES)


class Splitting(DiskTask):
    """A recording that is divided into several logs, in the place of others."""

    def __init__(self) -> None:
        self._config = ConvertConfig(split_ns=MESSAGES // 3)

    def prepare(self, folder: Path) -> None:
        write(folder / SOURCE, "old")
        convert([folder / SOURCE], folder / OUT, ConvertConfig(split_ns=MESSAGES // 5))
        (folder / SOURCE).unlink()
        write(folder / SOURCE, "new")

    def run(self, folder: Path, promised: Promised) -> None:
        convert([folder / SOURCE], folder / OUT, self._config, overwrite=True)
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        assert is_whole(folder / SOURCE, "new", MESSAGES)
        parts = sorted(folder.glob("out_*.mcap"))
        found = [data_of(part) for part in parts]
        if promised.done:
            assert b"".join(map(b"".join, found)) == b"".join(payload("new", number) for number in range(MESSAGES))
        old = [payload("old", number) for number in range(MESSAGES)]
        new = [payload("new", number) for number in range(MESSAGES)]
        for data in found:
            assert data
            assert any(data == run[start : start + len(data)] for run in (old, new) for start in range(MESSAGES))

    def run_again(self, folder: Path) -> None:
        convert([folder / SOURCE], folder / OUT, self._config, overwrite=True)
        self.check(folder, Promised(done=True), "kill")


@pytest.mark.parametrize("overwrite", [False, True])
@in_every_way(11)
def test_a_conversion_is_there_whole_or_not_at_all(tmp_path: Path, step: int, overwrite: bool) -> None:
    sweep(Converting(overwrite=overwrite), tmp_path, step)


@in_every_way(11)
def test_each_part_of_a_conversion_is_whole(tmp_path: Path, step: int) -> None:
    sweep(Splitting(), tmp_path, step)


def remove_unsynced(self: object, stale: list[Path]) -> None:
    for path in stale:
        disk.unlink(path)


@pytest.mark.parametrize("fault", [Fault(), Fault(6, "crash before")], ids=["came back", "gone already"])
def test_parts_that_are_replaced_come_back_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: Fault
) -> None:
    """After a power failure they were there again; and one that was set aside could not be removed."""
    (tmp_path / "now").mkdir()
    fail_once(Splitting(), tmp_path / "now", fault)
    monkeypatch.setattr("recorders.conversion.convert._Writing._remove", remove_unsynced)
    with pytest.raises((AssertionError, OSError)):
        fail_once(Splitting(), tmp_path, fault)


def test_a_part_of_which_a_crash_left_zeros_is_in_nobodys_way(tmp_path: Path) -> None:
    task = Splitting()
    task.prepare(tmp_path)
    (tmp_path / "out_001.mcap.part").write_bytes(bytes(100))
    task.run_again(tmp_path)


def test_a_full_disk_is_not_said_to_be_the_recording(tmp_path: Path) -> None:
    with stepped_threads(), LogWriter(tmp_path / SOURCE, manifest={}, attachments={"a.urdf": bytes(100_000)}) as log:
        log.write(TOPIC, payload("new", 0), log_time_ns=0, type_name=TYPE)
    simulated = SimulatedDisk(tmp_path, Fault(3, "ENOSPC"))
    with (
        simulated.installed(),
        pytest.raises(LogError, match=r"^cannot write .*out.mcap.part: No space left on device$"),
    ):
        convert([tmp_path / SOURCE], tmp_path / OUT)
    assert simulated.operations[3] == "write"
