"""Planted faults: each turns `golden check` red, with the right tier and place; without one it is green."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from faults import FAULTS, Fault, use_plain_kernels
from faults_of_content import CONTENT_FAULTS, ContentFault, folder_of

from pipeline.cli import app
from pipeline.exploration.episode import ExplorationConfig
from pipeline.exploration.explore import explore
from pipeline.golden.runner import GoldenRunner
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import Motion
from pipeline.motions.patterns.circles import circles
from pipeline.robot.config import load_robot
from replay.golden.add import add_case
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("catches")
    robot, log = load_robot("asimo"), folder / "small.mcap"
    whole = circles(robot)
    motion = Motion("small", whole.times_s[:8], whole.targets[:8], closed=False)
    explore(robot, motion, seed=2, out=log, config=ExplorationConfig(settle_ns=200_000_000))
    learner = LearnerConfig(reservoir=20, seed=4).to_dict()
    # The checkpoint falls into the middle of the fourth presentation.
    recipe = CaseSpec((log,), learner, Schedule(epochs=2), resume_after=3 * 9 + 4, physics=True)
    return add_case(folder / "cases" / "small", recipe, GoldenRunner()).folder


def checked(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    with pytest.raises(SystemExit) as ended:
        app.main(["golden", "check", str(folder), "--json"])
    code = ended.value.code
    assert isinstance(code, int)
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return code, found


def test_nothing_is_found_where_nothing_is_wrong(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_plain_kernels(monkeypatch)  # compiled kernels made the case
    code, found = checked(case, capsys)
    assert (code, found["checked"], found["failed"]) == (0, 1, 0), found


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_it_catches(
    fault: Fault, case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "small"
    shutil.copytree(case, copy)
    use_plain_kernels(monkeypatch)
    fault.plant(monkeypatch, copy)
    code, found = checked(copy, capsys)
    assert code == 1
    assert found["failed"] == 1
    (verdict,) = found["cases"]
    divergence = verdict["first_divergence"]
    assert verdict["tier"] == fault.tier, divergence["text"]
    assert divergence["field"] == fault.field, divergence["text"]
    assert {name: divergence.get(name) for name in fault.place} == fault.place, divergence["text"]
    assert fault.note in divergence["note"], divergence["text"]
    assert divergence["expected"] == (fault.expected or divergence["expected"])
    assert divergence["found"] == (fault.found or divergence["found"])
    check_end(fault, divergence["epoch_end"])
    assert divergence["expected"] != divergence["found"]


@pytest.mark.parametrize("fault", CONTENT_FAULTS, ids=lambda fault: fault.name)
def test_a_shipped_case_catches_what_the_small_one_cannot(
    fault: ContentFault, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_plain_kernels(monkeypatch)
    fault.plant(monkeypatch)
    code, found = checked(folder_of(fault), capsys)
    assert code == 1
    (verdict,) = found["cases"]
    divergence = verdict["first_divergence"]
    assert verdict["tier"] == "learning", divergence["text"]
    assert divergence["field"] == fault.field, divergence["text"]
    assert divergence["note"] == fault.note, divergence["text"]
    assert divergence["expected"] != divergence["found"]


def check_end(fault: Fault, end: dict[str, Any] | None) -> None:
    """Check the element that differs at the end of the epoch."""
    if not fault.end:
        assert end is None
        return
    assert end is not None
    assert end["epoch"] == 0
    assert end["expected"] != end["found"]
    text = f"{end['field']}: expected {end['expected']}, found {end['found']}"
    assert re.match(fault.end, text), text
