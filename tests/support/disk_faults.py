"""Every operation of a task fails once, in every way; after each what was promised is there, and a second start works."""

import os
import shutil
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from disk_journal import OUTCOMES
from simulated_disk import CRASHES, ERRORS, Fault, SimulatedDisk

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


@dataclass
class Tally:
    """How often which operation failed, by kind of fault, and how many states were looked at."""

    failed: Counter[str] = field(default_factory=Counter)
    states: int = 0

    def add(self, other: "Tally") -> None:
        """Take in the counts of another."""
        self.failed.update(other.failed)
        self.states += other.states


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
    """

    def __init__(self, task: DiskTask, folder: Path, *, draws: int = 2) -> None:
        self._task, self._folder, self._draws = task, folder, draws
        self.tally = Tally()
        self._begin = folder / "begin"
        self._begin.mkdir()
        task.prepare(self._begin)

    def run(self, *, kinds: Sequence[str] = (*ERRORS, *CRASHES), first: int = 0, step: int = 1) -> Tally:
        """Fail every operation, or every `step`-th from the `first`, in every way; returns the counts."""
        operations = self._failed(Fault())
        for kind in kinds:
            for at in range(first, len(operations), step):  # up to the first that fails they are the same
                if _applies(kind, operations[at]):
                    self._failed(Fault(at, kind))
        return self.tally

    def _failed(self, fault: Fault) -> list[str]:
        """Do the task with one fault and look at all that may be left; returns the operations."""
        root = shutil.copytree(self._begin, self._folder / "disk")
        promised, open_before = Promised(), _descriptors()
        disk = SimulatedDisk(root, fault)
        try:
            with disk.installed():
                self._task.run(root, promised)
        except BaseException as error:
            if not disk.crashed:  # otherwise nobody is there who would see it
                _check_error(error, disk)
        where = f"{fault}: {disk.operations[fault.at] if disk.failed else 'none'}"
        self.tally.failed[fault.kind] += disk.failed
        try:
            disk.journal.check()
            self._look(disk, promised)
            assert _descriptors() == open_before, "files are left open"
        except BaseException as error:
            error.add_note(where)
            raise
        finally:
            shutil.rmtree(self._folder / "disk")
        return disk.operations

    def _look(self, disk: SimulatedDisk, promised: Promised) -> None:
        for outcome, seed in _outcomes(self._draws):
            left = self._folder / "left"
            try:
                disk.journal.survivors(left, outcome, seed=seed)
                self._task.check(left, promised, outcome)
                self._task.run_again(left)
            except BaseException as error:
                error.add_note(f"{promised}, {outcome}, draw {seed}: {sorted(map(str, left.rglob('*')))}")
                raise
            finally:
                shutil.rmtree(left)
            self.tally.states += 1


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
        for seed in range(draws if outcome in ("prefix", "subset") else 1):
            yield outcome, seed


def _descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))
