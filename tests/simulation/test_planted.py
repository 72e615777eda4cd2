"""Bugs planted in the protocol are found by the seeds that `make test` runs, or change nothing to be noticed."""

import logging
import statistics

import pytest
from planted import all_bugs, draw_bugs, seeds_to_find

SEEDS = range(2_000)
BUGS = 80
HANDFUL = 4

CHANGES_NOTHING: dict[tuple[str, str, str], str] = {}
"""Why a bug shows nowhere, by function, line and change."""


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Simulated clocks jump by the thousand, which need not be logged."""
    caplog.set_level(logging.ERROR, logger="recorders.recording.log_clock")


def test_a_handful_of_planted_bugs_is_found() -> None:
    for bug in draw_bugs(HANDFUL, seed=15):
        assert bug.key in CHANGES_NOTHING or seeds_to_find(bug, SEEDS[:100]) is not None, bug


def test_what_changes_nothing_is_there() -> None:
    assert set(CHANGES_NOTHING) <= {bug.key for bug in all_bugs()}


@pytest.mark.campaign
@pytest.mark.timeout(7_200)
def test_every_planted_bug_is_found_or_changes_nothing() -> None:
    bugs = draw_bugs(BUGS, seed=15)
    taken = {bug: seeds_to_find(bug, SEEDS) for bug in bugs if bug.key not in CHANGES_NOTHING}
    assert [bug.key for bug, seeds in taken.items() if seeds is None] == []
    assert len(set(bugs)) >= 60
    print(f"{len(taken)} found, in a median of {statistics.median(filter(None, taken.values()))} seeds")
