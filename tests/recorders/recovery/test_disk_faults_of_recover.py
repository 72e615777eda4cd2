"""Every operation of a recovery fails, in every way: the damaged log stays, and the sound one is whole or not there."""

from pathlib import Path

import pytest
from disk_faults import DiskTask, Promised, in_every_way, sweep
from log_content import TOPIC, TYPE, holds, payload
from stepped_threads import stepped_threads

from recorders.reading.reader import LogReader
from recorders.recovery.recover import recover
from recorders.writing.writer import LogWriter

MESSAGES = 200
DAMAGED, OUT = "damaged.mcap.part", "sound.mcap"


class Recovering(DiskTask):
    """A log that is cut off."""

    def __init__(self, *, overwrite: bool) -> None:
        self.overwrite = overwrite
        self._damaged = b""

    def prepare(self, folder: Path) -> None:
        with (
            stepped_threads(),
            LogWriter(folder / "whole.mcap", manifest={}, attachments={"a.urdf": b"a" * 999}) as log,
        ):
            for number in range(MESSAGES):
                log.write(TOPIC, payload("new", number), log_time_ns=number, type_name=TYPE)
        raw = (folder / "whole.mcap").read_bytes()
        self._damaged = raw[: len(raw) // 2]
        (folder / "whole.mcap").unlink()
        (folder / DAMAGED).write_bytes(self._damaged)
        if self.overwrite:
            with stepped_threads(), LogWriter(folder / OUT, manifest={}) as log:
                log.write(TOPIC, payload("old", 0), log_time_ns=0, type_name=TYPE)

    def run(self, folder: Path, promised: Promised) -> None:
        recover(folder / DAMAGED, folder / OUT, overwrite=self.overwrite)
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        assert (folder / DAMAGED).read_bytes() == self._damaged
        out = folder / OUT
        if not out.exists():
            assert not self.overwrite
            assert not promised.done
        elif promised.done or not holds(out, "old", 1):
            assert holds(out, "new", 64)
            assert LogReader(out).attachment("a.urdf") == b"a" * 999
            assert LogReader(out).manifest["messages"] == sum(1 for _ in LogReader(out))

    def run_again(self, folder: Path) -> None:
        recover(folder / DAMAGED, folder / OUT, overwrite=True)
        self.check(folder, Promised(done=True), "kill")


@pytest.mark.parametrize("overwrite", [False, True])
@in_every_way(17)
def test_a_recovered_log_is_there_whole_or_not_at_all(tmp_path: Path, step: int, overwrite: bool) -> None:
    sweep(Recovering(overwrite=overwrite), tmp_path, step)
