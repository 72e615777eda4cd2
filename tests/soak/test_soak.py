"""Robot, controller, learner and recorder for hours: nothing missed, and no process grows; what finds a growth."""

import json
import mmap
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from process_sample import process_sample
from slopes import overall_slope, steady_slope
from soak_nodes import SoakConfig
from soak_verdict import verdict

from recorders.messages.topics import CLOCK, JOINT_COMMANDS, JOINT_STATES, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS

SOAK, SUPPORT = Path(__file__).with_name("soak.py"), Path(__file__).parents[1] / "support"
TIMES_S = np.arange(720) * 5.0


@pytest.mark.campaign
@pytest.mark.extra
@pytest.mark.timeout(6 * 3600)
@pytest.mark.parametrize(
    "options", [("--hours", "24"), ("--hours", "1", "--rate", "200", "--real-time")], ids=["a day", "an hour"]
)
def test_nothing_is_missed_and_nothing_grows(options: tuple[str, ...], tmp_path: Path) -> None:
    command = [sys.executable, str(SOAK), *options, "--out", str(tmp_path)]
    run = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(SUPPORT)}, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["problems"] == []


@pytest.mark.extra
def test_a_leak_is_found_behind_noise_outliers_and_steps() -> None:
    random = np.random.default_rng(0)
    noise = random.normal(0.0, 50_000.0, len(TIMES_S))
    noise[::40] += 5e6  # bytes, for a moment
    stepped = noise + np.where(TIMES_S > 2_000.0, 9e6, 0.0)
    assert overall_slope(TIMES_S, stepped).low > 0.0
    assert steady_slope(TIMES_S, stepped).low <= 0.0 <= steady_slope(TIMES_S, stepped).high
    for slope, series in ((steady_slope, stepped), (overall_slope, noise)):
        found = slope(TIMES_S, 1e8 + 1_000.0 * TIMES_S + series)
        assert found.low > 0.0
        assert found.slope == pytest.approx(1_000.0, rel=0.2)


@pytest.mark.extra
@pytest.mark.parametrize(
    ("rate_hz", "real_time", "problems"),
    [
        (1.0, False, []),
        (1.0, True, []),
        (1.01, True, []),
        (1.1, True, ["expected 1.1 ticks a second, found 1.0"]),
        (1.1, False, ["expected 3960 ticks, found 3600 that were driven"]),
    ],
)
def test_a_verdict_names_what_grows_and_what_is_missing(rate_hz: float, real_time: bool, problems: list[str]) -> None:
    config = SoakConfig(hours=1.0, rate_hz=rate_hz, real_time=real_time)
    process = {"anonymous": 0, "descriptors": 10, "threads": 5}
    growing = [2e8 + 5_000.0 * time_s for time_s in TIMES_S]
    samples = [
        {
            "time_s": time_s,
            "processes": {"learner": {**process, "resident": size}, "robot": {**process, "resident": 2e8}},
            "counts": {},
        }
        for time_s, size in zip(TIMES_S.tolist(), growing, strict=True)
    ]
    log = dict.fromkeys((LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, JOINT_COMMANDS, CLOCK, JOINT_STATES), 3_600)
    ended = {
        "driven": {"ticks": 3_600, "missed": 0},
        "counts": {"controller": {"commands": 3_600}, "robot": {"commands": 3_599}},
        "learned_ticks": 3_600,
        "recording": {"messages": 21_600, "gaps": {}, "refused": {}, "broken": []},
        "log": {"messages": log},
        "exit": {"learner": 0, "recorder": 0, "controller": 143, "robot": 143},
    }
    found = verdict(samples, ended, config)
    assert found["problems"] == [
        *problems,
        "commands that moved the robot: expected 3600, found 3599",
        "learner: its memory grows by 18.000 MB an hour (18.000 at least)",
    ]
    assert not found["holds"]


@pytest.mark.extra
@pytest.mark.parametrize("slope", [overall_slope, steady_slope])
def test_a_slope_of_too_few_samples_is_refused(slope: Callable[..., object]) -> None:
    with pytest.raises(ValueError, match="at least 72 samples, found 71"):
        slope(TIMES_S[:71], TIMES_S[:71])


def test_a_sample_is_of_this_process() -> None:
    before = process_sample(os.getpid())
    size = 50_000_000
    with mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as block:  # not of what it has freed
        block.write(b"x" * size)
        with Path(__file__).open():
            after = process_sample(os.getpid())
    assert after.descriptors == before.descriptors + 1
    assert after.anonymous - before.anonymous > 0.9 * size
    assert before.threads >= 1
