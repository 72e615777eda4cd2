"""Worlds in which the protocol once broke a promise: each with the faults that it took, and no others."""

import logging
from collections.abc import Sequence

import pytest
from simulation.run import simulate
from simulation.scenario import ConsumerPlan, Fault, Scenario, draw_faults, draw_scenario
from simulation.world import MS

LEARNER = ConsumerPlan("learner", "learner", consume_ns=MS // 10, durable_every=1, waiting_bytes=1 << 20)
RECORDER = ConsumerPlan("recorder", "recorder", consume_ns=20 * MS, durable_every=1_000, waiting_bytes=1 << 20)


def world(*consumers: ConsumerPlan, messages: int = 50) -> Scenario:
    return Scenario(
        seed=900,
        messages=messages,
        most_bytes=8,
        window=12,
        window_bytes=1 << 20,
        batch_size=6,
        latency_ns=2 * MS,
        gap_ns=5 * MS,
        counted=True,
        calm=False,
        gentle=True,
        consumers=consumers,
    )


FOUND = {
    "an offer that is lost once fails the whole replay": (world(LEARNER), [Fault("lost", "question learner", 0)]),
    "so does its answer": (world(LEARNER), [Fault("lost", "answer learner", 0)]),
    "a consumer lacks what is gone while another is greeted anew": (
        world(RECORDER, LEARNER),
        [
            Fault("lost", "answer recorder", 3),
            Fault("lost", "answer recorder", 5),
            Fault("lost", "data learner", 0),
            Fault("lost", "data learner", 3),
            Fault("late", "data learner", 5, 2_835_918),
            Fault("lost", "answer learner", 5),
            Fault("lost", "answer learner", 12),
            Fault("kill", "recorder", 43, 3_093_171_459),
            Fault("kill", "learner", 67, 50_456_980),
        ],
    ),
}


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Simulated clocks jump by the thousand, which need not be logged."""
    caplog.set_level(logging.ERROR, logger="recorders.recording.log_clock")


# A frame that was late arrives between the acceptance of an offer and its answer, which was late too.
LATE_FRAME = 4667, (0, 3, 84, 85, 219, 223, 224, 225, 226, 229, 268, 269, 270, 305, 306, 308, 342, 390)


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_stays_mended(name: str) -> None:
    scenario, faults = FOUND[name]
    outcome = simulate(scenario, faults)
    assert outcome.found == ""
    assert outcome.errors == ()
    assert outcome.occurred


def test_a_stream_is_digested_from_where_it_began_at_both_ends() -> None:
    seed, places = LATE_FRAME
    scenario = draw_scenario(seed)
    faults = draw_faults(scenario)
    outcome = simulate(scenario, [faults[place] for place in places])
    assert (outcome.found, outcome.errors) == ("", ())
    assert outcome.occurred


def test_a_world_without_faults_holds() -> None:
    faults: Sequence[Fault] = ()
    assert simulate(world(LEARNER, RECORDER), faults).found == ""
