"""Many seeds over all cores: what they met, and which of them broke a promise, with their schedules shrunk."""

import gc
import multiprocessing
import os
import statistics
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from simulation.run import Outcome, run_seed, simulate
from simulation.scenario import KINDS, Fault, draw_faults, draw_scenario
from simulation.shrink import shrunk

LEAST_FAULTS = 50
"""What the median seed has to meet at least."""

_CHUNK = 25  # seeds that a process takes at once


class Failure(NamedTuple):
    """A seed that broke a promise, and the fewest faults of its schedule with which it still does."""

    outcome: Outcome
    places: tuple[int, ...]
    faults: tuple[Fault, ...]

    @property
    def command(self) -> str:
        """The command that repeats it."""
        only = ",".join(map(str, self.places)) or "none"
        return f"make simulate FROM={self.outcome.seed} SEEDS=1 ONLY={only}"


@dataclass
class Summary:
    """What many seeds met.

    Attributes
    ----------
    seeds, events : int
        How many seeds ran, and how many events all of them had.
    faults : counter of str
        The faults that occurred, by kind.
    totals : list of int
        How many occurred in each seed.
    stated : int
        In how many seeds somebody stated an error, before the stream got through.
    broken : list of Outcome
        Of the seeds that broke a promise.
    """

    seeds: int = 0
    events: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    totals: list[int] = field(default_factory=list)
    stated: int = 0
    broken: list[Outcome] = field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        """Add a seed."""
        self.seeds += 1
        self.events += outcome.events
        self.faults += outcome.occurred
        self.totals.append(outcome.occurred.total())
        self.stated += bool(outcome.errors)
        if outcome.broken:
            self.broken.append(outcome)

    def merge(self, other: "Summary") -> None:
        """Add the seeds of another summary."""
        self.seeds += other.seeds
        self.events += other.events
        self.faults += other.faults
        self.totals += other.totals
        self.stated += other.stated
        self.broken += other.broken

    @property
    def median_faults(self) -> float:
        """How many faults the median seed met."""
        return statistics.median(self.totals)

    def lacks(self) -> list[str]:
        """Return why these seeds prove too little: kinds of faults that never occurred, or too few faults a seed."""
        absent = [f"no fault of kind {kind!r} occurred" for kind in KINDS if not self.faults[kind]]
        if self.median_faults < LEAST_FAULTS:
            absent.append(f"the median seed met {self.median_faults:g} faults, {LEAST_FAULTS} are to be met")
        return absent


def run_seeds(seeds: Sequence[int]) -> Summary:
    """Simulate seeds, one after the other."""
    summary = Summary()
    gc.disable()  # little of a world is in cycles, and looking for them takes a tenth of the time
    try:
        for seed in seeds:
            summary.add(run_seed(seed))
    finally:
        gc.enable()
    return summary


def run_on_all_cores(seeds: range, *, on_progress: Callable[[float], None] = lambda fraction: None) -> Summary:
    """Simulate seeds in as many processes as there are cores; the summary is the same with any number of them."""
    summary, done = Summary(), 0
    chunks = [seeds[start : start + _CHUNK] for start in range(0, len(seeds), _CHUNK)]
    if len(chunks) == 1:
        return run_seeds(seeds)
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for part in pool.imap(run_seeds, chunks):
            summary.merge(part)
            done += 1
            on_progress(done / len(chunks))
    return summary


def shrink(outcome: Outcome) -> Failure:
    """Leave out of a failed seed's schedule what its failure does not need."""
    scenario = draw_scenario(outcome.seed)
    faults = draw_faults(scenario)

    def fails(places: Sequence[int]) -> bool:
        """Whether these faults alone break the same promise."""
        return simulate(scenario, [faults[place] for place in places]).broken == outcome.broken

    places = tuple(shrunk(range(len(faults)), fails))
    return Failure(outcome, places, tuple(faults[place] for place in places))
