"""An emulated arm64 comes to the digests of this machine; where it cannot be made, one line names what is missing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from emulated_machine import EmulatedMachine, MissingError

COMPARE, TREE = Path(__file__).with_name("compare.py"), Path(__file__).parents[2]


@pytest.mark.campaign
@pytest.mark.timeout(3 * 3600)
def test_arm64_comes_to_the_same_digests() -> None:
    command = [sys.executable, str(COMPARE), "--folder", str(TREE / "out" / "arm64")]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode == 2 and not os.environ.get("REENACT_TEST_EVERYTHING"):
        pytest.skip(run.stderr.strip())
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("equal ") > 20


def test_without_apt_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingError, match=r"^apt-get is not here: expected Debian or one of its kind"):
        EmulatedMachine(tmp_path / "machine").make()


def test_an_apt_that_offers_nothing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("apt-get", "dpkg-deb"):
        tool = tmp_path / name
        tool.write_text("#!/bin/sh\nexit 100\n")
        tool.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingError, match=r"^apt offers none of python3.11, python3.12, python3.13 for arm64"):
        EmulatedMachine(tmp_path / "machine").make()
