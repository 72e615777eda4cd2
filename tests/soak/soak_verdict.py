"""What a soak shows: what was missed, and what of each process grows."""

from collections.abc import Iterator, Sequence
from typing import Any

from slopes import Slope, overall_slope, steady_slope
from soak_nodes import SoakConfig

from recorders.messages.topics import CLOCK, JOINT_COMMANDS, JOINT_STATES, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS

WARM_UP = 1 / 6
"""The part of a soak, from its beginning, in which processes may still grow: code and caches are loaded."""

MISSED = {
    "recorder": ("gaps", "refused", "broken"),
    "robot": ("refused",),
    "controller": ("refused",),
    "learner": ("dropped", "gaps", "refused"),
    "explorer": ("missed",),
}
"""Counts of each node's status that say that it has missed something."""

_HOUR_S = 3600.0
_RATE_HELD = 0.99  # part of the rate asked for that is to be reached with the clock on the wall
_NEGLIGIBLE = 0.01  # part of its size by which a process may grow in the whole soak, whatever its interval


def missed(counts: dict[str, Any], kind: str) -> int:
    """Return how many messages a node says that it has missed."""
    return sum(counts.get(kind, {}).get(name, 0) for name in MISSED[kind])


def after_warm_up(samples: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the samples that count."""
    begin = samples[-1]["time_s"] * WARM_UP
    return [sample for sample in samples if sample["time_s"] >= begin]


def verdict(samples: Sequence[dict[str, Any]], ended: dict[str, Any], config: SoakConfig) -> dict[str, Any]:
    """Return of each process slopes and ranges, a line for each finding, and whether all holds.

    A process grows if both of its slopes, within blocks and from end to end, are above 0 with 99 % confidence, and that
    by more than is negligible.
    """
    counted = after_warm_up(samples)
    processes = {kind: _process(counted, kind) for kind in counted[0]["processes"]}
    problems = [*_losses(ended, config), *(line for kind, found in processes.items() for line in _growth(kind, found))]
    lines = [_line(kind, found) for kind, found in processes.items()]
    return {"processes": processes, "findings": [*lines, *problems], "holds": not problems, "problems": problems}


def _process(samples: Sequence[dict[str, Any]], kind: str) -> dict[str, Any]:
    times = [sample["time_s"] for sample in samples]
    series = {name: [sample["processes"][kind][name] for sample in samples] for name in samples[0]["processes"][kind]}
    hours = (times[-1] - times[0]) / _HOUR_S
    found: dict[str, Any] = {"hours": hours, "mean": sum(series["resident"]) / len(times)}
    for name, slope in (("overall", overall_slope), ("steady", steady_slope)):
        found[name] = Slope(*(value * _HOUR_S for value in slope(times, series["resident"])))
    for name in ("descriptors", "threads"):
        found[name] = min(series[name]), max(series[name])
    return found


def _growth(kind: str, found: dict[str, Any]) -> Iterator[str]:
    overall, steady = found["overall"], found["steady"]
    if min(overall.low, steady.low) > 0.0 and overall.slope * found["hours"] > _NEGLIGIBLE * found["mean"]:
        yield f"{kind}: its memory grows by {overall.slope / 1e6:.3f} MB an hour ({overall.low / 1e6:.3f} at least)"
    for name in ("descriptors", "threads"):
        low, high = found[name]
        if low != high:
            yield f"{kind}: expected as many {name} throughout, found {low} to {high}"


def _line(kind: str, found: dict[str, Any]) -> str:
    slopes = (f"{name} {_megabytes(found[name])}" for name in ("steady", "overall"))
    descriptors, threads = (" to ".join(map(str, sorted(set(found[name])))) for name in ("descriptors", "threads"))
    return (
        f"{kind:<10}  {found['mean'] / 1e6:5.1f} MB; slope [MB an hour, 99 %]: {', '.join(slopes)}; "
        f"{descriptors} descriptors, {threads} threads"
    )


def _megabytes(slope: Slope) -> str:
    return f"{slope.slope / 1e6:+.3f} ({slope.low / 1e6:+.3f} to {slope.high / 1e6:+.3f})"


def _losses(ended: dict[str, Any], config: SoakConfig) -> Iterator[str]:
    """Yield what of the messages is not where it should be."""
    ticks, counts, log = ended["driven"]["ticks"], ended["counts"], ended["log"]["messages"]
    if not config.real_time and ticks != config.ticks:
        yield f"expected {config.ticks} ticks, found {ticks} that were driven"
    elif ticks < _RATE_HELD * config.ticks:  # a robot that is late leaves no tick out: its time is late, too
        yield f"expected {config.rate_hz:g} ticks a second, found {ticks / (3600.0 * config.hours):.1f}"
    commands, robot = counts["controller"]["commands"], counts["robot"]["commands"]
    expected = {
        "ticks that were learned": ended["learned_ticks"],
        "commands of the controller": commands,
        "commands that moved the robot": robot,
        **{f"messages of {topic} in the log": log.get(topic, 0) for topic in _OF_A_TICK},
    }
    yield from (f"{what}: expected {ticks}, found {found}" for what, found in expected.items() if found != ticks)
    yield from (f"{kind}: has missed {count}: {counts.get(kind)}" for kind in MISSED if (count := missed(counts, kind)))
    if ended["driven"]["missed"]:
        yield f"explorer: {ended['driven']['missed']} states of the robot did not come"
    recording = ended["recording"]
    if recording["gaps"] or recording["refused"] or recording["broken"]:
        yield f"recorder: gaps {recording['gaps']}, refused {recording['refused']}, broken {recording['broken']}"
    if sum(log.values()) != recording["messages"]:
        yield f"the log holds {sum(log.values())} messages of {recording['messages']} that were recorded"
    if log.get(CLOCK) != log.get(JOINT_STATES):
        yield f"{log.get(CLOCK)} clocks and {log.get(JOINT_STATES)} states of the robot in the log: expected as many"
    ends = {"learner": 0, "recorder": 0, "controller": 143, "robot": 143}
    yield from (
        f"{kind}: expected exit status {ends[kind]}, found {status}"
        for kind, status in ended["exit"].items()
        if status not in (ends[kind], -15)
    )


_OF_A_TICK = (LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, JOINT_COMMANDS)
