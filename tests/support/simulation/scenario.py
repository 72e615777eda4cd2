"""Scenarios: who sends what to whom, drawn from a seed; and their faults, as data that can be shrunk."""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from simulation.world import MS, SECOND, draws

SENDER = "replay"
KEY = b"known to both ends, nobody else."
"""The shared key, 32 bytes."""
CHANNELS = ("data", "question", "answer", "acknowledgement")
PACKET_FAULTS = ("lost", "repeated", "late", "altered")
OUTAGES = ("cut", "stall", "disk full", "clock jump", "impostor")
NODE_FAULTS = (
    *OUTAGES,
    "source pauses",
    "source fails",
    "sender killed",
    "consumer killed",
)
FORGERIES = (
    "message",
    "batch",
    "end",
    "abort",
    "acknowledgement",
    "result",
    "failure",
    "offer",
    "question",
    "farewell",
    "answer",
)
COPIES = ("data", "question", "offer", "answer", "acknowledgement")  # what a peer sends once more, as it overheard it

KINDS = (
    *(f"{channel} {kind}" for channel in CHANNELS for kind in PACKET_FAULTS),
    *NODE_FAULTS,
    *(f"{kind} forged" for kind in FORGERIES),
    *(f"{kind} copied" for kind in COPIES),
)
"""Every kind of fault; a run in which one of them does not occur proves nothing."""

_PACKETS = 160  # of each channel that may meet a fault: later ones arrive
_TROUBLE_NS = 60 * SECOND  # after it, nothing new goes wrong


class Fault(NamedTuple):
    """Something that goes wrong.

    `kind` is what, `where` a channel and a consumer, or a node; `at` the number of the packet, step or message that it
    meets, or a time [ns]; `amount` a duration [ns], or which of several ways.
    """

    kind: str
    where: str
    at: int
    amount: int = 0


def is_timed(fault: Fault) -> bool:
    """Whether a fault comes at a time, and not at a packet, a step or a message."""
    return fault.kind in OUTAGES or fault.kind.endswith((" forged", " copied"))


@dataclass(frozen=True)
class ConsumerPlan:
    """A consumer: of which kind, how fast it is, and how often what it has is durable."""

    name: str
    kind: str  # "learner" or "recorder"
    consume_ns: int
    durable_every: int  # messages
    waiting_bytes: int
    decide_ns: int = 0  # whether to accept the first offer; the next takes half as long
    refuses: int = 0  # offers, the first ones


@dataclass(frozen=True)
class Scenario:
    """All that a seed draws but its faults."""

    seed: int
    messages: int
    most_bytes: int  # of a message
    window: int
    window_bytes: int
    batch_size: int
    latency_ns: int
    gap_ns: int  # between messages of the source
    wait_s: float  # for each consumer
    counted: bool  # whether the offer gives the number of messages
    calm: bool  # nothing goes wrong
    gentle: bool  # no outage is as long as anybody's patience, nobody fails for good: the first sender gets through
    consumers: tuple[ConsumerPlan, ...]


def draw_scenario(seed: int) -> Scenario:
    """Return the scenario of a seed."""
    draw = draws(seed, "scenario")
    calm = seed % 16 == 0
    window = draw.randint(1, 12)
    kinds = draw.choice((("learner",), ("learner", "recorder"), ("learner", "recorder"), ("recorder", "learner-2")))
    gentle = draw.random() < 0.5
    return Scenario(
        seed=seed,
        messages=draw.randint(18, 48),
        most_bytes=draw.choice((8, 100 if calm else 40)),
        window=window,
        window_bytes=draw.choice((120, 1_000, 1 << 20)),
        batch_size=draw.randint(1, window) if draw.random() < 0.7 else 1,
        latency_ns=MS // 10 if calm else draw.choice((MS // 10, 2 * MS, 30 * MS)),
        gap_ns=draw.choice((0, 0, 5 * MS, 200 * MS)),
        wait_s=0.2 if calm else 10.0,
        counted=draw.random() < 0.7,
        calm=calm,
        gentle=gentle,
        consumers=tuple(_draw_consumer(draw, name, calm=calm, gentle=gentle) for name in kinds),
    )


def _draw_consumer(draw: random.Random, name: str, *, calm: bool, gentle: bool) -> ConsumerPlan:
    return ConsumerPlan(
        name=name,
        kind=name.partition("-")[0],
        consume_ns=draw.choice((0, MS // 10, 20 * MS)),
        durable_every=draw.choice((1, 5, 1_000)),
        waiting_bytes=1 << 20 if calm else draw.choice((3_000, 1 << 20)),
        decide_ns=300 * MS if calm else draw.choice((0, 0, 20 * MS, SECOND, 3 * SECOND if gentle else 15 * SECOND)),
        refuses=0 if calm or gentle else draw.choice((0, 0, 1)),
    )


def draw_faults(scenario: Scenario) -> list[Fault]:
    """Return the faults that a seed brings upon its scenario; those whose time never comes do not occur."""
    seed = scenario.seed
    found: list[Fault] = []
    if scenario.calm:
        return found
    for consumer in scenario.consumers:
        for channel in CHANNELS:
            where = f"{channel} {consumer.name}"
            # Of three questions in a row one is answered: who is patient for six need not give up.
            least_gap = 3 if scenario.gentle and channel in ("question", "answer") else 1
            found += _packet_faults(draws(seed, where), where, least_gap=least_gap)
    found += _outages(draws(seed, "outages"), scenario)
    found += _kills(draws(seed, "kills"), scenario)
    found += _forgeries(draws(seed, "forgeries"), scenario)
    found += _impostors(draws(seed, "impostors"), scenario)
    return found


def _packet_faults(draw: random.Random, where: str, *, least_gap: int) -> Iterator[Fault]:
    """Faults of single packets on one channel, as often as this channel has them."""
    mean_gap = draw.choice((2, 3, 3, 4))
    packet = draw.randint(0, 2 * mean_gap)
    while packet < _PACKETS:
        kind = draw.choice(PACKET_FAULTS)
        amount = draw.choice((3 * MS, 80 * MS, 400 * MS, 2 * SECOND)) if kind in ("late", "repeated") else 0
        yield Fault(kind, where, packet, draw.randint(0, amount) if amount else draw.randrange(1 << 16))
        packet += max(least_gap, draw.randint(1, 2 * mean_gap - 1))


def _outages(draw: random.Random, scenario: Scenario) -> Iterator[Fault]:
    """Cut connections, stalls, full disks, clocks that jump, and a source that pauses."""
    names = [consumer.name for consumer in scenario.consumers]
    longest = 3 * SECOND if scenario.gentle else 50 * SECOND
    for kind, where, most in (("cut", names, 3), ("stall", [*names, SENDER], 3), ("disk full", names, 1)):
        for _ in range(draw.randint(0, most)):
            if not (kind == "disk full" and scenario.gentle):
                yield Fault(kind, draw.choice(where), _moment(draw), draw.randint(0, draw.choice((SECOND, longest))))
    for _ in range(draw.randint(0, 2)):
        jump = draw.choice((-3_600, -1, 1, 3 if scenario.gentle else 3_600)) * SECOND
        yield Fault("clock jump", draw.choice([*names, SENDER]), _moment(draw), jump)
    if draw.random() < 0.3:
        message = draw.choice((0, draw.randrange(scenario.messages)))
        yield Fault("source pauses", SENDER, message, draw.randint(SECOND, 60 * SECOND))
    if not scenario.gentle and draw.random() < 0.2:
        yield Fault("source fails", SENDER, draw.randrange(scenario.messages))


def _kills(draw: random.Random, scenario: Scenario) -> Iterator[Fault]:
    """Nodes that are killed at one of their steps, and how long they are gone."""
    for consumer in scenario.consumers:
        for _ in range(draw.choice((0, 1, 1, 2))):
            yield Fault("kill", consumer.name, draw.randint(1, 300), draw.randint(MS, 4 * SECOND))
    if not scenario.gentle and draw.random() < 0.5:
        yield Fault("kill", SENDER, draw.randint(1, 300), draw.randint(MS, 10 * SECOND))


def _forgeries(draw: random.Random, scenario: Scenario) -> Iterator[Fault]:
    """What a hostile peer sends to a consumer, or to the sender in the consumer's name, and when."""
    for _ in range(draw.choice((0, 5, 20))):
        where = draw.choice(scenario.consumers).name
        if draw.random() < 0.3:
            yield Fault(f"{draw.choice(COPIES)} copied", where, _moment(draw), draw.randrange(1 << 16))
        else:
            yield Fault(f"{draw.choice(FORGERIES)} forged", where, _moment(draw), draw.randrange(1 << 16))


def _impostors(draw: random.Random, scenario: Scenario) -> Iterator[Fault]:
    """For how long a hostile peer answers every question before the consumer does, in its name."""
    for _ in range(draw.choice((0, 0, 1, 2))):
        yield Fault("impostor", draw.choice(scenario.consumers).name, _moment(draw), draw.randint(0, _TROUBLE_NS))


def _moment(draw: random.Random) -> int:
    """Return a time at which things may go wrong: mostly early, when most happens."""
    return draw.randint(0, draw.choice((SECOND // 2, 5 * SECOND, _TROUBLE_NS)))
