"""Bugs planted in the protocol by operators over its syntax tree are found by the seeds that `make test` runs."""

import logging
import statistics
import tomllib
from pathlib import Path

import pytest
from planted import all_bugs, draw_bugs, seeds_to_find

SEEDS = range(2_000)
BUGS = 70

HANDFUL = (
    (
        "incoming.IncomingStream.new_part",
        "if frame.first > received or not (frame.end > received or is_end):",
        "frame.first > received -> frame.first <= received",
    ),
    (
        "send_window.SendWindow.has_room",
        "under_way = self.sent - self.consumed",
        "self.sent - self.consumed -> self.sent + self.consumed",
    ),
    ("seals.sealing.SenderSeals.is_answer", "return False", "False -> True"),
)
"""Function, line and change of bugs that `make test` plants."""

REVIEWED = {
    (function, entry["line"], entry["change"]): entry.get("found_by", "")
    for function, entries in tomllib.loads((Path(__file__).parent / "equivalent.toml").read_text()).items()
    for entry in entries
    if entry["reason"]
}
"""Bugs that worlds do not show, by function, line and change: the test that finds each, none if it changes nothing."""


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Simulated clocks jump by the thousand, which need not be logged."""
    caplog.set_level(logging.ERROR, logger="recorders.recording.log_clock")


@pytest.mark.parametrize("key", HANDFUL, ids=[f"{function}: {change}" for function, _, change in HANDFUL])
def test_a_planted_bug_is_found(key: tuple[str, str, str]) -> None:
    bug = next(bug for bug in all_bugs() if bug.key == key)
    assert seeds_to_find(bug, SEEDS[:100]) is not None


def test_what_was_reviewed_is_there() -> None:
    assert set(REVIEWED) <= {bug.key for bug in all_bugs()}
    for test in filter(None, REVIEWED.values()):
        file, _, function = test.partition("::")
        assert f"def {function}(" in (Path(__file__).parents[1] / "recorders" / "protocol" / file).read_text()


@pytest.mark.campaign
@pytest.mark.timeout(7_200)
def test_planted_bugs_are_found_but_for_those_that_were_reviewed() -> None:
    taken = {bug: seeds_to_find(bug, SEEDS) for bug in draw_bugs(BUGS, seed=15) if bug.key not in REVIEWED}
    for bug, seeds in taken.items():
        print(f"not found: {bug}" if seeds is None else f"{seeds} seeds: {bug}")
    found = [seeds for seeds in taken.values() if seeds is not None]
    print(f"{len(found)} of {len(taken)} found, in a median of {statistics.median(found)} seeds")
    assert len(found) == len(taken)
