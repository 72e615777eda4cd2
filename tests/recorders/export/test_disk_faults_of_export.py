"""Every operation of an export fails, in every way: all its tables are there, or none."""

from pathlib import Path

import numpy as np
import pytest
from disk_faults import DiskTask, Promised, in_every_way, sweep
from stepped_threads import stepped_threads

from recorders.export.export import export
from recorders.messages.message_types import Float64MultiArray, String
from recorders.writing.writer import LogWriter

MESSAGES = 30
SOURCE, OUT = "source.mcap", "tables"


class Exporting(DiskTask):
    """A recording of two topics."""

    def __init__(self, form: str, expected: dict[str, bytes]) -> None:
        self.form, self.expected = form, expected

    def prepare(self, folder: Path) -> None:
        with stepped_threads(), LogWriter(folder / SOURCE, manifest={}) as log:
            for number in range(MESSAGES):
                log.write("/a", String("text " * 100), log_time_ns=number)
                log.write("/b", Float64MultiArray(np.arange(3.0)), log_time_ns=number)

    def run(self, folder: Path, promised: Promised) -> None:
        export(folder / SOURCE, folder / OUT, form=self.form)
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        if (folder / OUT).exists():
            assert {path.name: path.read_bytes() for path in (folder / OUT).iterdir()} == self.expected
        else:
            assert not promised.done

    def run_again(self, folder: Path) -> None:
        if not (folder / OUT).exists():
            export(folder / SOURCE, folder / OUT, form=self.form)
            self.check(folder, Promised(done=True), "kill")
            assert sorted(path.name for path in folder.iterdir()) == [SOURCE, OUT]  # what was left of before is gone


@pytest.mark.parametrize("form", ["csv", "parquet"])
@in_every_way(17)
def test_tables_are_there_whole_or_not_at_all(tmp_path: Path, step: int, form: str) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    (tmp_path / "first").mkdir()
    task = Exporting(form, {})
    task.prepare(tmp_path / "first")
    task.run(tmp_path / "first", Promised())
    task.expected = {path.name: path.read_bytes() for path in (tmp_path / "first" / OUT).iterdir()}
    sweep(task, tmp_path, step)
