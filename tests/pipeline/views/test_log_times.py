"""The times of a recording are drawn, unless it is damaged or there is nothing to draw."""

from pathlib import Path

import pytest
from episodes import write_plain_episode
from typer.testing import CliRunner

from pipeline.cli import app as cli
from recorders.errors import ConfigError
from recorders.messages.message_types import String
from recorders.recovery.log_info import summarise
from recorders.recovery.log_times import read_times
from recorders.writing.writer import LogWriter

pytest.importorskip("matplotlib")

from pipeline.views.log_times import draw_log_times, topic_title  # of an extra

PNG = b"\x89PNG\r\n"


@pytest.mark.extra
def test_info_draws_the_times_of_a_log(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", measured=True)
    run = CliRunner().invoke(cli.app, ["info", str(log), "--plot", str(tmp_path / "one.png")])
    assert run.exit_code == 0, run.output
    assert (tmp_path / "one.png").read_bytes().startswith(PNG)


@pytest.mark.extra
def test_the_rates_that_are_drawn_are_those_of_info(tmp_path: Path) -> None:
    """Means, not what is usual between gaps."""
    log = tmp_path / "log.mcap"
    with LogWriter(log, manifest={"kind": "test"}) as writer:
        for tick in [*range(60), *range(120, 181)]:
            writer.write("/chatter", String("here"), log_time_ns=tick * 10**8)
    (rate_hz,) = (topic.rate_hz for topic in summarise(log).topics.values())
    assert rate_hz == pytest.approx(120 / 18.0)
    assert [topic_title(*each) for each in read_times(log).items()] == [f"/chatter: 121 messages, {rate_hz:.2f} Hz"]


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
