"""Every operation of a task fails in every way; after each what was promised is there, and a second start works."""

import hashlib
import logging
import shutil
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from disk_journal import DRAWN, OUTCOMES, write_tree
from simulated_disk import KINDS, Fault, SimulatedDisk

from recorders.errors import ReenactError


@dataclass
class Promised:
    """What a task was promised so far.

    Attributes
    ----------
    handed, synced : int
        How much survives the end of the process, and that of the machine.
    done : bool
        Whether the task came to its end.
    """

    handed: int = 0
    synced: int = 0
    done: bool = False

    def least(self, outcome: str) -> int:
        """Return how much must be there after a crash."""
        return self.handed if outcome == "kill" else self.synced


class DiskTask(ABC):
    """Something that is done in a folder."""

    @abstractmethod
    def prepare(self, folder: Path) -> None:
        """Put there what is there before."""

    @abstractmethod
    def run(self, folder: Path, promised: Promised) -> None:
        """Do it, and note what is promised meanwhile."""

    @abstractmethod
    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        """Assert that what was promised is there, and nothing that is half."""

    @abstractmethod
    def run_again(self, folder: Path) -> None:
        """Do it once more on a sound disk, and assert that it is done."""


def in_every_way(some: int) -> pytest.MarkDecorator:
    """Give a test the `step` of a sweep: every so many-th operation fails in `make test`, all in the campaign."""
    every = pytest.param(1, id="all", marks=(pytest.mark.campaign, pytest.mark.timeout(3600)))
    return pytest.mark.parametrize("step", [pytest.param(some, id="some"), every])


def fail_once(task: DiskTask, folder: Path, fault: Fault) -> None:
    """Have one operation of a task fail, and look at all that may be left."""
    Sweep(task, folder, draws=12).fail(fault)


def sweep(task: DiskTask, folder: Path, step: int) -> None:
    """Fail every `step`-th operation of a task in every way, and print how many failed."""
    swept = Sweep(task, folder, draws=1 if step > 1 else 12)
    logging.disable()  # what is set aside is reported, again and again
    try:
        swept.run(step)
    finally:
        logging.disable(logging.NOTSET)
    print(
        f"{type(task).__name__}: {swept.failed.total()} operations failed ({dict(swept.failed)}), {swept.states} states"
    )


class Sweep:
    """Has the operations of a task fail.

    Parameters
    ----------
    task : DiskTask
        What is done.
    folder : Path
        Where there is room for folders.
    draws : int
        How many states of the disk are drawn for each crash that leaves some to chance.

    Attributes
    ----------
    failed : Counter
        How many operations failed, by kind of fault.
    states : int
        How many states of the disk were looked at.
    """

    def __init__(self, task: DiskTask, folder: Path, *, draws: int) -> None:
        self._task, self._folder, self._draws = task, folder, draws
        self.failed: Counter[str] = Counter()
        self.states = 0
        self._sound: set[bytes] = set()
        self._begin = folder / "begin"
        self._begin.mkdir()
        task.prepare(self._begin)

    def run(self, step: int) -> None:
        """Fail every `step`-th operation, each kind of fault beginning with another, in every way."""
        operations = self.fail(Fault())
        for kind in KINDS:
            for at in range(zlib.crc32(kind.encode()) % step, len(operations), step):
                if _applies(kind, operations[at]):  # up to the first that fails they are the same
                    self.fail(Fault(at, kind))

    def fail(self, fault: Fault) -> list[str]:
        """Do the task with one fault and look at all that may be left; returns the operations."""
        root = shutil.copytree(self._begin, self._folder / "disk")
        promised = Promised()
        disk = SimulatedDisk(root, fault)
        try:
            with disk.installed():
                self._task.run(root, promised)
        except BaseException as error:
            if not disk.crashed:  # otherwise nobody is there who would see it
                _check_error(error, disk)
        where = f"{fault}: {disk.operations[fault.at] if disk.failed else 'none'}"
        if disk.failed:
            self.failed[fault.kind] += 1
        try:
            disk.journal.check()
            self._look(disk, promised)
            assert _open_files(root) == [], "files are left open"
        except BaseException as error:
            error.add_note(where)
            raise
        finally:
            shutil.rmtree(self._folder / "disk")
        return disk.operations

    def _look(self, disk: SimulatedDisk, promised: Promised) -> None:
        """Look at everything that may be left; what has been found sound before, with the same promises, still is."""
        for outcome, seed in _outcomes(self._draws):
            tree = disk.journal.survivors(outcome, seed=seed)
            self.states += 1
            state = hashlib.sha256(repr((sorted(tree.items()), promised, outcome == "kill")).encode()).digest()
            if state in self._sound:
                continue
            left = self._folder / "left"
            try:
                write_tree(tree, left)
                self._task.check(left, promised, outcome)
                self._task.run_again(left)
            except BaseException as error:
                error.add_note(f"{promised}, {outcome}, draw {seed}: {sorted(tree)}")
                raise
            finally:
                shutil.rmtree(left)
            self._sound.add(state)


def _check_error(error: BaseException, disk: SimulatedDisk) -> None:
    """Assert that an error is one of ours, of one line, and of a fault; raises all others."""
    if not isinstance(error, ReenactError):
        raise error
    assert disk.failed, f"failed without a fault: {error}"
    assert "\n" not in str(error)


def _applies(kind: str, operation: str) -> bool:
    """Whether an operation can fail so."""
    return operation == "write" or kind not in ("short", "crash within")


def _outcomes(draws: int) -> Iterator[tuple[str, int]]:
    for outcome in OUTCOMES:
        for seed in range(draws if outcome in DRAWN else 1):
            yield outcome, seed


def _open_files(folder: Path) -> list[str]:
    """Return the files in a folder that this process has open, those without a name too."""
    found = []
    for descriptor in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # it may be closed by now
            found.append(str(descriptor.readlink()))
    return [name for name in found if name.startswith(f"{folder}/")]
