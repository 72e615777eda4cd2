"""Whoever leads an exploration is named in its log, with settings, and simulated again from it."""

import json
from pathlib import Path

import pytest
from short_motion import write_short_motion
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.exploration.leader import leader_of, leader_settings
from pipeline.exploration.reproduce import simulate
from pipeline.exploration.self_explorer import SelfExplorerConfig
from pipeline.exploration.source import source
from pipeline.teacher.qp_config import QpTeacherConfig
from pipeline.teacher.teacher import TeacherConfig
from recorders.cdr.codec import encode
from recorders.errors import ConfigError
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.reader import LogReader


def test_the_second_teacher_leads_when_asked_and_is_simulated_again_from_the_log(tmp_path: Path) -> None:
    motion, log = write_short_motion(tmp_path / "short.csv"), tmp_path / "log.mcap"

    asked = ["explore", "--motion", str(motion), "--teacher", "qp", "--comfort-gain", "3", "--out", str(log), "--json"]
    run = CliRunner().invoke(app, asked)

    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["ticks"] == 4
    manifest = LogReader(log).manifest
    assert "teacher" not in manifest
    assert leader_of(manifest) == QpTeacherConfig(comfort_gain=3.0)
    logged = [record.data for record in LogReader(log).records(topics=[SAMPLE_JOINTS])]
    assert [encode(message) for topic, message in simulate(log, ticks=4) if topic == SAMPLE_JOINTS] == logged


@pytest.mark.parametrize("leader", [TeacherConfig(gain=3.0), QpTeacherConfig(gain=3.0), SelfExplorerConfig(gain=3.0)])
def test_settings_name_who_leads(leader: TeacherConfig | QpTeacherConfig | SelfExplorerConfig) -> None:
    assert leader_of({"kind": "exploration", **leader_settings(leader)}) == leader


def test_a_teacher_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match="expected one of rates, qp, found 'pq'"):
        source("circles", teacher="pq")
