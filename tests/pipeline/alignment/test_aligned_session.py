"""Phase markers of a recording stay between its ticks: what is written of it is learned as recorded, or as it is."""

import json
from pathlib import Path
from typing import Any

import pytest
from lab import MAPPED, MS, recording, run
from sessions import write_foreign

from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import String
from recorders.messages.phase import LEARN, WASHOUT, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader

PERIOD = 40 * MS
AT = (0, 300, 700)  # messages before each marker
PHASES = (WASHOUT, LEARN, LEARN)


@pytest.fixture
def session(robot: Path, tmp_path: Path) -> Path:
    """Write a recording with a marker at its start and two within it."""
    records = recording(robot)
    for number, at in reversed(list(enumerate(AT))):
        message = Phase("lab", 0, number, PHASES[number], log="").to_message()
        data = encode(message)
        records.insert(at, RecordedMessage(SESSION_PHASE, String.TYPE, data, number, records[at].log_time_ns))
    return write_foreign(tmp_path / "session.mcap", records)


@pytest.fixture
def converted(session: Path, robot: Path, tmp_path: Path) -> Path:
    words = (*MAPPED, "--rule", "forward-inverse", "--tick-rate", 25, "--robot", robot)
    assert run("convert", session, *words, "--out", tmp_path / "ticks.mcap", "--json") == 0
    return tmp_path / "ticks.mcap"


def test_markers_stand_before_the_tick_that_followed(session: Path, converted: Path) -> None:
    there = list(LogReader(converted))
    markers = [record for record in there if record.topic == SESSION_PHASE]
    assert [record.data for record in markers] == [r.data for r in LogReader(session) if r.topic == SESSION_PHASE]
    for marker in markers:
        place = there.index(marker)
        assert there[place + 1].log_time_ns == marker.log_time_ns
        assert all(record.log_time_ns < marker.log_time_ns for record in there[:place])
    numbers = [record.sequence for record in there if record.topic == SAMPLE_JOINTS]
    assert numbers[-1] - numbers[0] == len(numbers) + 1  # a number is left out at each of two cuts


def test_a_session_of_others_is_learned_as_recorded(
    converted: Path, session: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The washout teaches nothing; without --as-recorded every tick teaches, as out of the recording itself."""
    words = ("--rule", "forward-inverse", "--epochs", 1, "--out", tmp_path / "s.npz", "--json")
    assert run("train", converted, "--as-recorded", *words) == 0
    followed = json.loads(capsys.readouterr().out)
    counts = LogReader(converted).counts
    assert followed["ticks"] == counts[SAMPLE_JOINTS]
    plain, _, _ = trained(converted)
    aligned, _, _ = trained(session, *MAPPED, "--tick-rate", 25)
    assert plain["digest"] == aligned["digest"] != followed["digest"]


def test_a_session_states_the_run_of_its_markers(converted: Path) -> None:
    runs = set()
    for record in LogReader(converted).records(topics=[SESSION_PHASE]):
        marker = decode(record.type, record.data)
        assert isinstance(marker, String)
        runs.add(Phase.from_message(marker).run)
    assert runs == {"lab"}
