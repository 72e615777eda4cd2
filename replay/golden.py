"""Golden-log regression: the cases of a folder checked against the present program."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recorders.errors import ConfigError, ReenactError
from replay.golden_case import CASE_FILE, Case, check_size, index_file, load_case
from replay.golden_finding import CASE, Finding
from replay.golden_learning import check_learning
from replay.golden_log import altered
from replay.golden_physics import check_physics
from replay.golden_recipe import Runner

PASSED, FAILED = "passed", "failed"


@dataclass(frozen=True)
class Verdict:
    """What became of one case; it passed if nothing was found."""

    name: str
    finding: Finding | None

    @property
    def status(self) -> str:
        """`passed` or `failed`."""
        return PASSED if self.finding is None else FAILED

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON: name, status, tier, first_divergence."""
        tier = None if self.finding is None else self.finding.tier
        divergence = None if self.finding is None else self.finding.to_dict()
        return {"name": self.name, "status": self.status, "tier": tier, "first_divergence": divergence}


def find_cases(folder: Path) -> list[Path]:
    """Return the folders of the cases in a folder, by name; a case's own folder is one.

    Raises
    ------
    ConfigError
        If there is none.
    """
    if (folder / CASE_FILE).is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob(f"*/{CASE_FILE}"))
    if not found:
        raise ConfigError(f"{folder}: expected golden cases, folders with a {CASE_FILE}; make one with golden add")
    return found


def check_case(folder: Path, runner: Runner) -> Verdict:
    """Check one case: its files, then the learning, then the physics; the first finding ends it."""
    try:
        case = load_case(folder)
        for name in case.files:
            case.read(name)
        finding = _altered_log(case) or check_learning(case, runner) or check_physics(case, runner)
    except ReenactError as error:
        finding = Finding(CASE, "file", "a sound golden case", str(error))
    return Verdict(folder.name, finding)


def check_all(
    folder: Path, runner: Runner, *, progress: Callable[[float], None] = lambda fraction: None
) -> Iterator[Verdict]:
    """Check the cases of a folder, one after the other.

    Raises
    ------
    ConfigError
        If there is none.
    """
    cases = find_cases(folder)
    for place, case in enumerate(cases):
        yield check_case(case, runner)
        progress((place + 1) / len(cases))


def summary(verdicts: list[Verdict]) -> Mapping[str, Any]:
    """Return the verdicts for JSON: checked, failed, cases."""
    failed = sum(verdict.finding is not None for verdict in verdicts)
    return {"checked": len(verdicts), "failed": failed, "cases": [verdict.to_dict() for verdict in verdicts]}


def _altered_log(case: Case) -> Finding | None:
    for path, entry in zip(case.recipe.logs, case.logs, strict=True):
        check_size(path)
        finding = altered(path, entry, case.read(index_file(entry.name)))
        if finding is not None:
            return finding
    return None
