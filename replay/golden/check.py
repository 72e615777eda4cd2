"""Golden-log regression: the cases of a folder checked against the present program."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from recorders.errors import MissingExtra
from replay.golden.case import STEPS_FILE, Case, check_size, check_steps, index_file, load_case
from replay.golden.finding import CASE, Finding, changed_environment, error_text
from replay.golden.folder import find_cases
from replay.golden.learning_tier import check_learning
from replay.golden.log_tier import LogIndex
from replay.golden.physics_tier import check_physics
from replay.golden.recipe import CaseSpec, Runner

Changed: TypeAlias = Callable[[CaseSpec], tuple[str, str, str] | None]
"""Names the first thing of a case that is not so any more: what, in the case, today."""

PASSED, FAILED = "passed", "failed"


def _nothing(recipe: CaseSpec) -> None:
    return None


@dataclass(frozen=True)
class Verdict:
    """The result of one case; it passed if nothing was found.

    Attributes
    ----------
    name : str
        The case.
    finding : Finding, optional
        The first thing that does not hold.
    not_checked : MissingExtra, optional
        Why the physics of the case was not checked, though it has one.
    """

    name: str
    finding: Finding | None
    not_checked: MissingExtra | None = None

    @property
    def status(self) -> str:
        """`passed` or `failed`."""
        return PASSED if self.finding is None else FAILED

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON: name, status, tier, first_divergence, and what physics lacks."""
        tier = None if self.finding is None else self.finding.tier
        divergence = None if self.finding is None else self.finding.to_dict()
        verdict = {"name": self.name, "status": self.status, "tier": tier, "first_divergence": divergence}
        return verdict if self.physics is None else verdict | {"physics": self.physics}

    @property
    def physics(self) -> str | None:
        """The extra to install for the physics of the case to be checked; None if nothing is missing."""
        return None if self.not_checked is None else f"not checked: install {self.not_checked.extra}"


def check_case(folder: Path, runner: Runner, *, changed: Changed = _nothing) -> Verdict:
    """Check one case: its files, then the learning, then the physics; the first finding ends it.

    A program that crashes is a finding too, of the tier at which it did. `changed` names in what that which a team uses
    today differs from the case's own copies.
    """
    name = folder.resolve().name
    try:
        return Verdict(name, _first(folder, runner, changed))
    except MissingExtra as missing:  # physics comes last: all else holds
        return Verdict(name, None, not_checked=missing)


def check_all(
    folder: Path,
    runner: Runner,
    *,
    changed: Changed = _nothing,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Iterator[Verdict]:
    """Check the cases of a folder, one after the other; a case is named by where it lies in the folder.

    Raises
    ------
    ConfigError
        As `find_cases` does.
    """
    cases = find_cases(folder)
    for place, case in enumerate(cases):
        verdict = check_case(case, runner, changed=changed)
        yield verdict if case == folder else replace(verdict, name=case.relative_to(folder).as_posix())
        progress((place + 1) / len(cases))


def summary(verdicts: list[Verdict]) -> Mapping[str, Any]:
    """Return the verdicts for JSON: checked, failed, cases, and physics_not_checked where it is not 0."""
    failed = sum(verdict.finding is not None for verdict in verdicts)
    not_checked = sum(verdict.not_checked is not None for verdict in verdicts)
    found = {"checked": len(verdicts), "failed": failed, "cases": [verdict.to_dict() for verdict in verdicts]}
    return found | {"physics_not_checked": not_checked} if not_checked else found


def _first(folder: Path, runner: Runner, changed: Changed) -> Finding | None:
    try:
        case = load_case(folder)
        for name in case.files:
            case.read(name)
        check_steps(case.read(STEPS_FILE))
        log = _altered_log(case)
        own = changed(case.recipe)
    except Exception as error:
        return Finding(CASE, "file", "a sound golden case", error_text(error))
    if log is not None:
        return log
    if own is not None:
        return Finding(CASE, *own, note="what is used today is not what the case was made with")
    finding = check_learning(case, runner) or check_physics(case, runner)
    return None if finding is None else replace(finding, environment=changed_environment(case.environment))


def _altered_log(case: Case) -> Finding | None:
    index = LogIndex(case.recipe.schedule.topics)
    for path, entry in zip(case.recipe.logs, case.logs, strict=True):
        check_size(path)
        indexed = case.read(index_file(entry.name))
        index.check(index_file(entry.name), indexed)
        finding = index.first_change(path, entry, indexed)
        if finding is not None:
            return finding
    return None
