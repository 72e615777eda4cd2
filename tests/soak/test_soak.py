"""Robot, controller, learner and recorder for hours: nothing missed, and no process grows; what finds a growth."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from process_sample import process_sample
from slopes import robust_slope

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
    assert result["driven"]["ticks"] > 100_000


@pytest.mark.extra
def test_a_leak_is_found_behind_noise_and_outliers() -> None:
    random = np.random.default_rng(0)
    noise = random.normal(0.0, 50_000.0, len(TIMES_S))
    noise[::40] += 5e6  # bytes, for a moment
    steady, leaking = robust_slope(TIMES_S, 1e8 + noise), robust_slope(TIMES_S, 1e8 + 100.0 * TIMES_S + noise)
    assert steady.is_zero
    assert leaking.low > 0.0
    assert leaking.slope == pytest.approx(100.0, rel=0.1)


@pytest.mark.extra
def test_a_slope_of_too_few_samples_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 24 samples, found 23"):
        robust_slope(TIMES_S[:23], TIMES_S[:23])


def test_a_sample_is_of_this_process() -> None:
    before = process_sample(os.getpid())
    block = bytearray(b"x" * 50_000_000)
    with Path(__file__).open():
        after = process_sample(os.getpid())
    assert after.descriptors == before.descriptors + 1
    assert after.anonymous - before.anonymous > 0.9 * len(block)
    assert before.threads >= 1
