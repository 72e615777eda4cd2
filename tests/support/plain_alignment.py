"""Alignment in plain Python, message by message and tick by tick: what the aligner in blocks must agree with."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Any

WAIT_NS = 10 * 10**9


class PlainTrack:
    """Samples of one topic: stamps, values, and the latest stamp of any topic that had come before each."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.values: list[list[float]] = []
        self.ahead: list[int] = []


def _line(a: list[float], b: list[float], f: float) -> list[float]:
    return [x + (y - x) * f for x, y in zip(a, b, strict=True)]


def _arc(a: list[float], b: list[float], f: float) -> list[float]:
    """Spherical interpolation by the angle between two unit quaternions, from libm."""
    dot = sum(x * y for x, y in zip(a, b, strict=True))
    b = [-x for x in b] if dot < 0 else list(b)
    chord = math.sqrt(sum((x - y) ** 2 for x, y in zip(a, b, strict=True)))
    total = math.sqrt(sum((x + y) ** 2 for x, y in zip(a, b, strict=True)))
    angle = 2.0 * math.atan2(chord, total)
    if angle < 1e-7:
        return _line(a, b, f)
    s = math.sin(angle)
    return [(math.sin((1 - f) * angle) * x + math.sin(f * angle) * y) / s for x, y in zip(a, b, strict=True)]


def align(
    messages: Sequence[tuple[str, int, list[float], bool]],
    topics: Sequence[str],
    *,
    tolerance: int,
    period: int | None = None,
    pivot: int = 0,
) -> list[tuple[int, dict[str, Any], bool]]:
    """Return [(stamp, values by topic, cut)] of messages (topic, stamp, values, turns), in order of arrival."""
    tracks = {topic: PlainTrack() for topic in topics}
    ahead = -(2**62)
    for topic, stamp, values, _ in messages:
        track = tracks[topic]
        if stamp > 0 and (not track.stamps or stamp > track.stamps[-1]):
            track.stamps.append(stamp)
            track.values.append(values)
            track.ahead.append(ahead)
            ahead = max(ahead, stamp)
    if not all(track.stamps for track in tracks.values()):
        return []
    pivot_stamps = tracks[topics[pivot]].stamps
    candidates: Sequence[int]
    if period is None:
        candidates = pivot_stamps
    else:
        candidates = range(-(-pivot_stamps[0] // period) * period, pivot_stamps[-1] + 1, period)
    turns = {topic: turned for topic, _, _, turned in messages}
    ticks: list[tuple[int, dict[str, Any], bool]] = []
    skipped, last = False, None
    for tick in candidates:
        found = {topic: _at(track, tick, tolerance, turns[topic]) for topic, track in tracks.items()}
        if None in found.values():
            skipped = True
            continue
        pause = period is None and last is not None and tick - last > max(10 * tolerance, 10**9)
        ticks.append((tick, found, bool(ticks) and (skipped or pause)))
        skipped, last = False, tick
    return ticks


def _at(track: PlainTrack, tick: int, tolerance: int, turns: bool) -> list[float] | None:
    after = bisect_left(track.stamps, tick)
    before = bisect_right(track.stamps, tick) - 1
    if before < 0 or after == len(track.stamps) or track.ahead[after] - tick > WAIT_NS:
        return None
    early, late = track.stamps[before], track.stamps[after]
    if early == tick:
        return track.values[before]
    if tick - early > tolerance or late - tick > tolerance:
        return None
    f, a, b = (tick - early) / (late - early), track.values[before], track.values[after]
    if not turns:
        return _line(a, b, f)
    return _line(a[:3], b[:3], f) + _arc(a[3:], b[3:], f)
