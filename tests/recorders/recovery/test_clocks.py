"""Clocks that disagree are found by topic, constant or drifting, and what comes late by little is none."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.terminal.log_tables import clock_lines, overview
from recorders.messages.message_types import JointState, PoseStamped
from recorders.recovery.clocks import ClockLine, Disagreement
from recorders.recovery.log_info import summarise
from recorders.recovery.log_times import NO_STAMP, read_times
from recorders.writing.writer import LogWriter

BEGIN_NS = 1_764_000_000_000_000_000
MS, S = 10**6, 10**9
JOINTS, POSE, OTHER = "/joint_states", "/tracker/pose", "/other/pose"


def log_of(path: Path, offset: Callable[[int], int], *, apart_ns: int = 0, count: int = 400) -> Path:
    """Write joints, another pose of the same clock, and a pose whose stamps are this far ahead."""
    late = np.random.default_rng(0).integers(0, 3 * MS, (count, 3)).tolist()
    messages = [
        (step * 10 * MS + late[step][place] + begin, topic, step * 10 * MS + begin)
        for step in range(count)
        for place, (topic, begin) in enumerate(((JOINTS, 0), (OTHER, 0), (POSE, apart_ns)))
    ]
    with LogWriter(path, manifest={"kind": "recording"}, attachments={}) as writer:
        for log_ns, topic, at_ns in sorted(messages):
            stamp = BEGIN_NS + at_ns + (offset(at_ns) if topic == POSE else 0)
            message = JointState(stamp, ("a",), [0.5]) if topic == JOINTS else PoseStamped(stamp, np.zeros(3))
            writer.write(topic, message, log_time_ns=BEGIN_NS + log_ns)
    return path


def found(path: Path) -> list[Disagreement]:
    return summarise(path).clocks


@pytest.mark.parametrize("ahead_ns", [3600 * S, -3600 * S, 300 * MS, -BEGIN_NS + S])
def test_an_offset_is_that_of_the_topic_that_differs(tmp_path: Path, ahead_ns: int) -> None:
    (each,) = found(log_of(tmp_path / "log.mcap", lambda at: ahead_ns))
    assert (each.topic, each.drift_ns) == (POSE, None)
    assert each.ahead_ns == pytest.approx(ahead_ns, abs=MS)


def test_a_clock_that_runs_fast_drifts(tmp_path: Path) -> None:
    (each,) = found(log_of(tmp_path / "log.mcap", lambda at: at // 10))
    assert each.topic == POSE
    assert each.drift_ns == pytest.approx(399 * MS, abs=2 * MS)


def test_what_comes_a_little_late_has_no_clock_of_its_own(tmp_path: Path) -> None:
    assert found(log_of(tmp_path / "log.mcap", lambda at: -60 * MS)) == []


def test_topics_of_different_times_are_not_compared(tmp_path: Path) -> None:
    assert found(log_of(tmp_path / "log.mcap", lambda at: 500 * MS, apart_ns=20 * S)) == []


def test_stamps_that_begin_anew_have_no_line(tmp_path: Path) -> None:
    """As of a log that is presented again and again: they are off by anything."""
    assert found(log_of(tmp_path / "log.mcap", lambda at: -(at - at % S))) == []


def test_the_line_is_that_of_numpy() -> None:
    draws = np.random.default_rng(1)
    times = np.sort(draws.integers(0, 10 * S, 500))
    ahead = (0.01 * times + draws.normal(0, MS, 500)).astype(np.int64) - 5 * S
    line = ClockLine()
    for time, each in zip(times.tolist(), ahead.tolist(), strict=True):
        line.add(BEGIN_NS + time, each)
    slope, start = np.polyfit(times / S, ahead / S, 1)
    assert line.slope == pytest.approx(slope, rel=1e-9)
    assert line.at(BEGIN_NS + 4 * S) == pytest.approx((start + 4 * slope) * S, rel=1e-9)
    assert line.scatter_ns == pytest.approx(np.std(ahead - (slope * times + start * S)), rel=1e-6)


def test_a_line_names_the_option_that_helps(tmp_path: Path) -> None:
    summary = summarise(log_of(tmp_path / "log.mcap", lambda at: 3600 * S))
    lines = list(clock_lines(summary, 80))
    assert all(len(line) <= 80 for line in lines)
    text = " ".join(lines)
    assert "stamps of /tracker/pose are 3600.000 s ahead of those of" in text
    assert "--latency /tracker/pose=3600 or --clock log puts it right" in text
    assert summary.to_dict()["clocks"][0]["topic"] == POSE


def test_times_of_a_clock_that_knows_the_date_have_it(tmp_path: Path) -> None:
    shown = overview(summarise(log_of(tmp_path / "log.mcap", lambda at: 0)))["time"]
    assert shown.startswith("2025-11-24 16:00:00 UTC to 2025-11-24 16:00:03 UTC: 1764000000")


def test_times_by_topic_are_those_of_the_messages(tmp_path: Path) -> None:
    times = read_times(log_of(tmp_path / "log.mcap", lambda at: 5))
    assert set(times) == {JOINTS, OTHER, POSE}
    assert (times[POSE].stamps_ns == BEGIN_NS + 5 + np.arange(400) * 10 * MS).all()
    assert (np.diff(times[POSE].log_times_ns) > 0).all()
    assert not (times[POSE].stamps_ns == NO_STAMP).any()
