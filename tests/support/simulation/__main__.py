"""Simulates seeds and reports: `make simulate SEEDS=1000 FROM=0`; with `ONLY=3,7` one seed meets but these faults."""

import argparse
import logging
import sys
import time
from dataclasses import asdict

from rich.console import Console
from rich.table import Table

from pipeline.terminal.console import progress
from simulation.campaign import Failure, Summary, run_on_all_cores, shrink
from simulation.run import simulate
from simulation.scenario import draw_faults, draw_scenario

_SHOWN = 5  # failures that are shrunk and shown

console = Console(highlight=False, soft_wrap=True)


def main(arguments: list[str] | None = None) -> int:
    """Simulate, report, and return 1 if a promise was broken, or if the seeds prove too little."""
    parser = argparse.ArgumentParser(prog="make simulate", description=__doc__)
    parser.add_argument("--seeds", type=int, default=2_000)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--only", default="", help="places in the schedule, or none")
    asked = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    if asked.only:
        return _repeat(asked.first, [] if asked.only == "none" else [int(place) for place in asked.only.split(",")])
    begun_s = time.monotonic()
    with progress("simulating") as show:
        summary = run_on_all_cores(range(asked.first, asked.first + asked.seeds), on_progress=show)
    _report(summary, time.monotonic() - begun_s)
    for outcome in summary.broken[:_SHOWN]:
        _report_failure(shrink(outcome))
    lacks = summary.lacks()
    for line in lacks:
        console.print(f"[red]{line}")
    return 1 if summary.broken or lacks else 0


def _report(summary: Summary, seconds: float) -> None:
    table = Table("kind of fault", "occurred", box=None)
    for kind, count in sorted(summary.faults.items(), key=lambda item: -item[1]):
        table.add_row(kind, f"{count:,}")
    console.print(table)
    total = summary.faults.total()
    console.print(
        f"{summary.seeds:,} seeds with {total:,} faults, {summary.median_faults:g} in the median seed, and "
        f"{summary.events:,} events in {seconds:.1f} s: {summary.seeds / seconds:.0f} seeds/s, "
        f"{total / seconds:,.0f} faults/s"
    )
    console.print(
        f"in {summary.stated:,} of them somebody stated an error before the stream got through; "
        f"{len(summary.broken):,} broke a promise"
    )


def _report_failure(failure: Failure) -> None:
    outcome = failure.outcome
    console.print(f"[red]seed {outcome.seed} broke a promise: {outcome.found}", markup=True)
    console.print(f"  repeat it: {failure.command}")
    for place, fault in zip(failure.places, failure.faults, strict=True):
        console.print(f"  {place}: {fault}", markup=False)


def _repeat(seed: int, places: list[int]) -> int:
    """Simulate one seed with some of its faults, and print all there is to see."""
    scenario = draw_scenario(seed)
    faults = draw_faults(scenario)
    for name, value in asdict(scenario).items():
        console.print(f"{name}: {value}", markup=False)
    for place in places:
        console.print(f"{place}: {faults[place]}", markup=False)
    outcome = simulate(
        scenario, [faults[place] for place in places], trace=lambda line: console.print(line, markup=False)
    )
    for error in outcome.errors:
        console.print(f"stated: {error}", markup=False)
    console.print(f"{outcome.events} events, over at {outcome.ended_ns / 1e9:.3f} s", markup=False)
    console.print(f"broken: {outcome.found or 'nothing'}", markup=False)
    return 1 if outcome.broken else 0


if __name__ == "__main__":
    sys.exit(main())
