"""What `info` prints fits the terminal, has an end, and breaks no word that has room."""

import pytest
from rich.cells import cell_len

from pipeline.terminal import console
from pipeline.terminal.escaping import wrapped
from pipeline.terminal.log_tables import damage_lines, overview, topic_lines
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import LEFT_TARGET
from recorders.recovery.log_info import summarise
from recorders.recovery.salvage import Damage
from recorders.writing.writer import LogWriter

HOUR_NS = 3600 * 10**9
LONG = "/a/very/long/name/of/a/topic/" + "that_goes_on_and_on/" * 20


@pytest.fixture
def log(tmp_path):
    """A log with one topic of an even rate and a gap, stamped an hour ahead, one of a long name and a burst."""
    with LogWriter(tmp_path / "a log with a name that is long.mcap", manifest={"robot": "x" * 90}) as writer:
        for tick in range(100):
            if tick not in (50, 51):
                time_ns = tick * 10**8
                writer.write(LEFT_TARGET, PoseStamped(time_ns + HOUR_NS, [0, 0, 0]), log_time_ns=time_ns)
            if tick == 99:
                writer.write(LONG, b"a", log_time_ns=10**10, opaque=True)
                writer.write(LONG, b"a", log_time_ns=10**10 + 1, opaque=True)
                writer.write("/" + "\u754c" * 100, b"a", log_time_ns=10**10 + 1, opaque=True)
    return tmp_path / "a log with a name that is long.mcap"


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_every_line_fits_the_terminal(log, columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    summary = summarise(log)
    console.entries(overview(summary))
    lines = [*capsys.readouterr().out.splitlines(), *topic_lines(summary, console.width())]
    lines += damage_lines([Damage(1, "a reason of many words " * 10, 5)] * 30, console.width())
    assert max(map(cell_len, lines)) <= columns


def test_what_is_said_of_a_topic(log):
    text = " ".join(" ".join(topic_lines(summarise(log), 80)).split())
    assert "98 messages, 9.80 Hz (stamps 9.80 Hz); 0.000 s to 9.900 s" in text
    assert "longest gap 300.0 ms after 4.900 s" in text
    assert "jitter 0 ns" in text
    assert "0 missing by number, about 2 missing by time" in text
    assert "stamps are 3600.000 s or more ahead of log time" in text
    assert "2 messages, no rate" in text
    assert f"{LEFT_TARGET} geometry_msgs/msg/PoseStamped" in text


def test_words_stay_whole_where_there_is_room():
    lines = list(wrapped("geometry_msgs/msg/PoseStamped is a type", 31, indent=" "))
    assert lines == [" geometry_msgs/msg/PoseStamped", " is a type"]
    assert list(wrapped("geometry_msgs/msg/PoseStamped", 24)) == ["geometry_msgs/msg/", "PoseStamped"]
