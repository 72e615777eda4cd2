"""Worlds in which the protocol once broke a promise: each with the faults that it took, and no others."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import pytest
from simulation.run import simulate
from simulation.scenario import ConsumerPlan, Fault, Scenario
from simulation.world import MS

LEARNER = ConsumerPlan("learner", "learner", consume_ns=MS // 10, durable_every=1, waiting_bytes=1 << 20)
RECORDER = ConsumerPlan("recorder", "recorder", consume_ns=20 * MS, durable_every=1_000, waiting_bytes=1 << 20)
SLOW = replace(LEARNER, decide_ns=3_000 * MS)


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
        wait_s=10.0,
        counted=True,
        calm=False,
        gentle=True,
        consumers=consumers,
    )


FOUND: dict[str, tuple[Scenario, list[Fault]]] = {
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
    # A frame that was late arrives between the acceptance of an offer and its answer, which was late too.
    "the ends digest a stream from different messages on": (
        Scenario(
            seed=4667,
            messages=48,
            most_bytes=8,
            window=10,
            window_bytes=120,
            batch_size=1,
            latency_ns=30 * MS,
            gap_ns=0,
            wait_s=10.0,
            counted=True,
            calm=False,
            gentle=True,
            consumers=(
                ConsumerPlan("recorder", "recorder", consume_ns=0, durable_every=1_000, waiting_bytes=3_000),
                ConsumerPlan("learner-2", "learner", consume_ns=20 * MS, durable_every=1, waiting_bytes=1 << 20),
            ),
        ),
        [
            Fault("late", "data recorder", 0, 217_620_885),
            Fault("late", "data recorder", 11, 978_793_580),
            Fault("altered", "answer recorder", 3, 51_737),
            Fault("lost", "answer recorder", 6),
            Fault("altered", "data learner-2", 5, 42_248),
            Fault("altered", "data learner-2", 16, 40_873),
            Fault("late", "data learner-2", 21, 5_441_419),
            Fault("altered", "data learner-2", 26, 46_914),
            Fault("lost", "data learner-2", 31),
            Fault("late", "data learner-2", 41, 1_793_540_113),
            Fault("altered", "question learner-2", 2, 21_285),
            Fault("repeated", "question learner-2", 5, 77_620_830),
            Fault("repeated", "question learner-2", 10, 129_723_990),
            Fault("altered", "answer learner-2", 5, 24_276),
            Fault("altered", "answer learner-2", 8, 48_020),
            Fault("lost", "answer learner-2", 17),
            Fault("lost", "acknowledgement learner-2", 0),
            Fault("kill", "learner-2", 98, 1_068_655_288),
        ],
    ),
    # Seed 17018: who decides for longer than an offer awaits its answer has answered nobody. The next ones likewise.
    "an answer that comes after the next offer is not taken": (
        replace(world(SLOW), latency_ns=30 * MS),
        [
            Fault("lost", "question learner", 3),
            Fault("lost", "question learner", 6),
            Fault("kill", "learner", 6, 961_649_153),
        ],
    ),
    "nor is that of a consumer that was stalled": (  # 10543
        world(SLOW),
        [
            Fault("lost", "question learner", 1),
            Fault("altered", "question learner", 4, 18_015),
            Fault("lost", "answer learner", 1),
            Fault("lost", "answer learner", 4),
            Fault("stall", "learner", 1_746_752_898, 2_443_158_192),
        ],
    ),
    "a clock that jumps counts as time that the consumer took": (  # 19588
        world(SLOW),
        [
            Fault("lost", "question learner", 0),
            Fault("clock jump", "replay", 357_630_579, 3_000 * MS),
            Fault("clock jump", "replay", 4_044_358_797, 3_000 * MS),
        ],
    ),
    "so it does while the connection is cut": (  # 10969
        world(replace(RECORDER, decide_ns=3_000 * MS)),
        [
            Fault("lost", "question recorder", 0),
            Fault("lost", "question recorder", 4),
            Fault("cut", "recorder", 1_110_738_999, 957_809_981),
            Fault("clock jump", "replay", 180_069_152, 3_000 * MS),
        ],
    ),
    # 63040, in which nothing goes wrong: of the 120 bytes that may be under way, a batch takes up to 103.
    "a large batch waits for an acknowledgement that is not due": (
        replace(
            world(
                replace(RECORDER, consume_ns=MS // 10), replace(LEARNER, name="learner-2", consume_ns=0), messages=19
            ),
            seed=63040,
            most_bytes=40,
            window=10,
            window_bytes=120,
            batch_size=4,
            latency_ns=MS // 10,
            gap_ns=0,
            calm=True,
        ),
        [],
    ),
    # 30302: the end that the learner has at once was overheard before it was killed, when it had begun at message 0.
    "an end of before a consumer was started anew is that of another stream": (
        replace(
            world(replace(LEARNER, consume_ns=0, decide_ns=1_000 * MS), messages=38),
            seed=30302,
            window_bytes=1_000,
            batch_size=7,
            latency_ns=30 * MS,
            counted=False,
        ),
        [
            Fault("altered", "data learner", 3, 46_238),
            Fault("lost", "data learner", 8),
            Fault("repeated", "question learner", 10, 31_831_842),
            Fault("lost", "question learner", 28),
            Fault("lost", "question learner", 34),
            Fault("lost", "answer learner", 21),
            Fault("lost", "answer learner", 29),
            Fault("late", "acknowledgement learner", 3, 1_131_053_938),
            Fault("cut", "learner", 31_316_706_650, 996_049_122),
            Fault("source pauses", "replay", 0, 27_102_893_636),
            Fault("data copied", "learner", 56_154_586_438, 12_662),
        ],
    ),
}


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Simulated clocks jump by the thousand, which need not be logged."""
    caplog.set_level(logging.ERROR, logger="recorders.recording.log_clock")


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_stays_mended(name: str) -> None:
    scenario, faults = FOUND[name]
    outcome = simulate(scenario, faults)
    assert outcome.found == ""
    assert outcome.errors == ()
    assert bool(outcome.occurred) == bool(faults)


def test_a_world_without_faults_holds() -> None:
    faults: Sequence[Fault] = ()
    assert simulate(world(LEARNER, RECORDER), faults).found == ""
