"""The times of a recording are drawn, unless it is damaged or there is nothing to draw."""

from pathlib import Path

import pytest
from episodes import write_plain_episode
from typer.testing import CliRunner

from pipeline.cli import app as cli
from recorders.errors import ConfigError
from recorders.recovery.log_times import read_times

pytest.importorskip("matplotlib")

from pipeline.views.log_times import draw_log_times  # of an extra

PNG = b"\x89PNG\r\n"


@pytest.mark.extra
def test_info_draws_the_times_of_a_log(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", measured=True)
    run = CliRunner().invoke(cli.app, ["info", str(log), "--plot", str(tmp_path / "one.png")])
    assert run.exit_code == 0, run.output
    assert (tmp_path / "one.png").read_bytes().startswith(PNG)


@pytest.mark.extra
def test_there_is_no_picture_of_a_damaged_log_nor_of_nothing(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap")
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(log.read_bytes()[:-200])
    run = CliRunner().invoke(cli.app, ["info", str(damaged), "--plot", str(tmp_path / "no.png")])
    assert run.exit_code == 1
    assert not (tmp_path / "no.png").exists()
    times = {"/one": next(iter(read_times(log).values()))}
    lone = {topic: type(each)(each.log_times_ns[:1], each.stamps_ns[:1]) for topic, each in times.items()}
    with pytest.raises(ConfigError, match="expected a topic of two messages or more"):
        draw_log_times(tmp_path / "no.png", lone, title="log")
