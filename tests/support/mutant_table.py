"""Modules that the mutation gate knows, with the tests that concern them, and mutants that change nothing."""

import random
import tomllib
from dataclasses import dataclass

from mutant_session import ROOT, Job
from mutation import Mutant, find_mutants

FOLDER = ROOT / "tests" / "mutation"


@dataclass(frozen=True)
class MutatedModule:
    """A row of `modules.toml`.

    Parameters
    ----------
    name : str
        What `MODULE=` calls it.
    files : tuple of str
        What is changed.
    tests : tuple of str
        Files of tests, or single ones, that have to notice it; quick ones.
    interpreted : bool
        Whether compiled kernels run uncompiled: a change then costs no compilation.
    """

    name: str
    files: tuple[str, ...]
    tests: tuple[str, ...]
    interpreted: bool = False

    def jobs(self) -> list[Job]:
        """Every mutant of its files, in order."""
        return [job for file in self.files for job in jobs_of(file)]


@dataclass(frozen=True)
class Equivalent:
    """A mutant that changes nothing that anybody is promised, and the reason.

    It is named by the source line's text and the change, so that it stays itself when lines move.
    """

    file: str
    line: str
    changes: tuple[str, ...]
    reason: str

    def names(self, job: Job) -> bool:
        """Return whether this is that mutant."""
        return job.file == self.file and line_text(job) == self.line and change_text(job.mutant) in self.changes


def jobs_of(file: str) -> list[Job]:
    """Every mutant of a file, in order."""
    return [Job(file, mutant) for mutant in find_mutants((ROOT / file).read_text())]


def mutated_modules() -> list[MutatedModule]:
    """Return the rows of `modules.toml`."""
    table = tomllib.loads((FOLDER / "modules.toml").read_text())
    return [
        MutatedModule(name, tuple(row["files"]), tuple(row["tests"]), row.get("interpreted", False))
        for name, row in table.items()
    ]


def equivalents() -> list[Equivalent]:
    """Return the entries of `equivalent.toml`."""
    table = tomllib.loads((FOLDER / "equivalent.toml").read_text())
    return [
        Equivalent(file, entry["line"], tuple(entry["changes"]), entry["reason"])
        for file, entries in table.items()
        for entry in entries
    ]


def stale(entries: list[Equivalent], modules: list[MutatedModule]) -> list[str]:
    """Return what entries name that is no mutant any more, or has no reason, a line for each."""
    named = {entry.file for entry in entries}
    jobs = [job for module in modules for file in module.files if file in named for job in jobs_of(file)]
    known = {(job.file, line_text(job), change_text(job.mutant)) for job in jobs}
    return [
        f"{entry.file}: {entry.line!r}, {change!r}"
        for entry in entries
        for change in entry.changes
        if (entry.file, entry.line, change) not in known or not entry.reason.strip()
    ]


def drawn(jobs: list[Job], *, sample: int | None, seed: int) -> list[Job]:
    """Draw some mutants, in their order; all without a number."""
    if sample is None or sample >= len(jobs):
        return jobs
    chosen = random.Random(seed).sample(range(len(jobs)), sample)
    return [jobs[place] for place in sorted(chosen)]


def line_text(job: Job) -> str:
    """Return the source line of a mutant, without its indent."""
    return (ROOT / job.file).read_text().splitlines()[job.mutant.line - 1].strip()


def change_text(mutant: Mutant) -> str:
    """Return what is changed, as `equivalent.toml` has it."""
    return f"{mutant.operator}: {mutant.before} -> {mutant.after or 'nothing'}"
