"""Whoever leads an exploration is named in its log, with settings, and simulated again from it."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from short_motion import write_short_motion
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.exploration.leader import leader_of, leader_settings
from pipeline.exploration.reproduce import simulate
from pipeline.exploration.self_explorer import SelfExplorerConfig
from pipeline.exploration.source import source
from pipeline.golden.runner import GoldenRunner, recipe
from pipeline.teacher.qp_config import SOLVER_SPREAD, QpTeacherConfig
from pipeline.teacher.teacher import TeacherConfig
from recorders.cdr.codec import encode
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState, Message
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from replay.golden.add import add_case
from replay.golden.check import check_case


class ShiftedRunner(GoldenRunner):
    """Simulates joints that are off [rad or m]."""

    def __init__(self, shift: float) -> None:
        self._shift = shift

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        for topic, message in super().simulate(log, ticks=ticks):
            if isinstance(message, JointState):
                message = replace(message, position=message.position + self._shift)
            yield topic, message


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a short exploration that the second teacher leads."""
    folder = tmp_path_factory.mktemp("leaders")
    motion, log = write_short_motion(folder / "short.csv"), folder / "log.mcap"
    asked = ["explore", "--motion", str(motion), "--teacher", "qp", "--comfort-gain", "3", "--out", str(log), "--json"]
    run = CliRunner().invoke(app, asked)
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["ticks"] == 4
    return log


def test_the_second_teacher_leads_when_asked_and_is_simulated_again_from_the_log(log: Path) -> None:
    manifest = LogReader(log).manifest
    assert "teacher" not in manifest
    assert leader_of(manifest) == QpTeacherConfig(comfort_gain=3.0)
    logged = [record.data for record in LogReader(log).records(topics=[SAMPLE_JOINTS])]
    assert [encode(message) for topic, message in simulate(log, ticks=4) if topic == SAMPLE_JOINTS] == logged


def test_golden_physics_of_the_second_teacher_lets_its_solver_end_elsewhere(log: Path, tmp_path: Path) -> None:
    (tmp_path / "ours.toml").write_text("reservoir = 12\n")
    case = add_case(tmp_path / "case", recipe([log], tmp_path / "ours.toml", epochs=1, physics=True), GoldenRunner())
    assert check_case(case.folder, ShiftedRunner(SOLVER_SPREAD / 10.0)).finding is None
    finding = check_case(case.folder, ShiftedRunner(2.0 * SOLVER_SPREAD)).finding
    assert finding is not None
    assert (finding.tier, finding.note) == ("physics", f"tolerance {SOLVER_SPREAD}")


@pytest.mark.parametrize("leader", [TeacherConfig(gain=3.0), QpTeacherConfig(gain=3.0), SelfExplorerConfig(gain=3.0)])
def test_settings_name_who_leads(leader: TeacherConfig | QpTeacherConfig | SelfExplorerConfig) -> None:
    assert leader_of({"kind": "exploration", **leader_settings(leader)}) == leader


def test_a_teacher_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match="expected one of rates, qp, found 'pq'"):
        source("circles", teacher="pq")
