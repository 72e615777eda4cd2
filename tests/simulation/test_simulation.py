"""The protocol in simulated worlds: whatever goes wrong, what it promises holds, and a seed repeats what does not."""

import logging
import random
from collections.abc import Sequence

import pytest
from simulation.campaign import LEAST_FAULTS, Summary, run_on_all_cores, run_seeds, shrink
from simulation.run import run_seed
from simulation.scenario import KINDS, draw_faults, draw_scenario
from simulation.shrink import shrunk
from simulation.world import draws

SEEDS = range(2_000)
CAMPAIGN_FAULTS = 10_000_000


def expect_all_promises(summary: Summary) -> None:
    """Fail with the command that repeats the first failure, and its schedule shrunk."""
    if summary.broken:
        failure = shrink(summary.broken[0])
        lines = [f"{place}: {fault}" for place, fault in zip(failure.places, failure.faults, strict=True)]
        pytest.fail("\n".join([failure.outcome.found, failure.command, *lines]))
    assert summary.lacks() == []


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Simulated clocks jump by the thousand, which need not be logged."""
    caplog.set_level(logging.ERROR, logger="recorders.recording.log_clock")


def test_every_promise_holds_whatever_goes_wrong() -> None:
    summary = run_on_all_cores(SEEDS)
    expect_all_promises(summary)
    assert summary.seeds == len(SEEDS)
    assert set(summary.faults) == set(KINDS)


@pytest.mark.campaign
@pytest.mark.timeout(7_200)
def test_every_promise_holds_through_ten_million_faults() -> None:
    summary, first = Summary(), len(SEEDS)
    while summary.faults.total() < CAMPAIGN_FAULTS:
        summary.merge(run_on_all_cores(range(first, first + 5_000)))
        first += 5_000
        expect_all_promises(summary)


def test_a_seed_is_the_same_world_each_time() -> None:
    assert [run_seed(seed) for seed in range(5)] == [run_seed(seed) for seed in range(5)]
    assert len({run_seed(seed).ended_ns for seed in range(5)}) == 5


def test_more_draws_for_one_purpose_shift_none_of_another() -> None:
    links, kills = draws(3, "links"), draws(3, "kills")
    links.random()
    assert kills.random() == draws(3, "kills").random() != draws(3, "links").random()
    scenario = draw_scenario(3)
    assert draw_faults(scenario) == draw_faults(scenario)


def test_too_few_faults_prove_nothing() -> None:
    summary = run_seeds(range(3))
    absent = set(KINDS) - set(summary.faults)
    assert absent
    assert all(any(kind in line for line in summary.lacks()) for kind in absent)
    quiet = Summary(seeds=1, totals=[LEAST_FAULTS - 1])
    assert f"the median seed met {LEAST_FAULTS - 1} faults, {LEAST_FAULTS} are to be met" in quiet.lacks()


@pytest.mark.parametrize("culprits", [(), (7,), (3, 41), (0, 1, 59), tuple(range(20))])
def test_shrinking_leaves_what_a_failure_needs(culprits: Sequence[int]) -> None:
    assert shrunk(range(60), lambda part: set(culprits) <= set(part)) == list(culprits)


def test_shrinking_ends_when_nothing_is_the_cause() -> None:
    draw = random.Random(5)
    left = shrunk(range(40), lambda part: draw.random() < 0.3, tries=500)
    assert left == sorted(set(left))
