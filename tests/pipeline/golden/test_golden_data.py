"""The golden cases that come with the program hold, and are small enough to lie beside it."""

from pathlib import Path

import pytest

from pipeline.golden.runner import GoldenRunner
from pipeline.resources import data_path
from pipeline.robot.config import load_robot
from recorders.cdr.codec import decode_as
from recorders.messages.message_types import JointState
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from replay.golden.case import load_case
from replay.golden.check import check_case
from replay.golden.folder import find_cases

CASES = find_cases(data_path("golden"))


@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_it_holds(folder: Path) -> None:
    assert check_case(folder, GoldenRunner()).finding is None


def test_physics_is_exact_but_for_the_oldest_log() -> None:
    logs = [log for case in map(load_case, CASES) if case.recipe.physics for log in case.recipe.logs]
    assert {log.name for log in logs if GoldenRunner().physics_tolerance(log) != 0.0} == {"eight_v1.mcap"}


def test_what_the_cases_are() -> None:
    cases = {path.name: load_case(path) for path in CASES}
    assert {"circles", "eight_v1", "right_hand_drawing", "live_session", "resumed", "two_logs"} <= set(cases)
    assert cases["feedback"].recipe.learner["output_output_density"] > 0.0
    joints = next(LogReader(cases["joints_by_name"].recipe.logs[0]).records(topics=[SAMPLE_JOINTS]))
    assert decode_as(JointState, joints.data).name != load_robot("asimo").joints
    assert sum(case.recipe.physics for case in cases.values()) >= 3
    assert cases["live_session"].recipe.as_recorded
    assert cases["resumed"].recipe.resume_after is not None
    assert LogReader(cases["eight_v1"].recipe.logs[0]).manifest["robot"] == "asimo"
    for path in CASES:
        assert sum(file.stat().st_size for file in path.iterdir()) < 300_000
