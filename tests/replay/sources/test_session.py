"""A recorded session is its markers and its learner's messages, in the order of the file, and nothing else."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from episodes import write_plain_episode
from sessions import write_foreign

from recorders.cdr.codec import encode
from recorders.errors import LogError, MessageError
from recorders.messages.message_types import Float64MultiArray, String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    COMMANDED_TICK,
    JOINT_STATES,
    LEARNER_OUTPUT,
    LEFT_TARGET,
    SESSION_PHASE,
    reached_tick,
)
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources import scheduled
from replay.sources.schedule import Schedule
from replay.sources.session import RecordedSession, stated_topics

RUN = "ab" * 16
STATED = Schedule(epochs=3, phases=((LEARN, 2),))
REACHED_TICK = reached_tick(("left", "right"))
ROBOT = {"robot.toml": b"[robot]", "robot.urdf": b"<robot/>"}


@pytest.fixture(scope="module")
def ticks(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedMessage]:
    return list(LogReader(write_plain_episode(tmp_path_factory.mktemp("session") / "log.mcap", samples=3)))


@pytest.fixture
def session(tmp_path: Path, ticks: list[RecordedMessage]) -> Callable[..., Path]:
    """Write a session, the stamps of its second cycle as those of its first."""

    def write(*, runs: tuple[str, ...] = (RUN, RUN), left: str = LEFT_TARGET, **manifest: Any) -> Path:
        path = tmp_path / "session.mcap"
        path.unlink(missing_ok=True)
        with LogWriter(path, manifest=manifest, attachments=ROBOT) as writer:
            for cycle, run in enumerate(runs):
                writer.write(SESSION_PHASE, Phase(run, 0, cycle, LEARN, log="").to_message(), log_time_ns=cycle)
                for record in ticks:
                    topic = left if record.topic == LEFT_TARGET else record.topic
                    writer.copy(record._replace(topic=topic))
                writer.write(LEARNER_OUTPUT, Float64MultiArray(np.zeros(1)), log_time_ns=0)
        return path

    return write


def test_it_is_markers_and_ticks_as_they_lie_in_the_file(
    session: Callable[..., Path], ticks: list[RecordedMessage]
) -> None:
    found = RecordedSession(session(schedule=STATED.to_dict()))
    stream = list(found.stream())
    assert len(found) == len(stream) == 2 * (1 + len(ticks))
    assert [place for place, record in enumerate(stream) if record.topic == SESSION_PHASE] == [0, 1 + len(ticks)]
    assert [(record.topic, record.data) for record in stream[1 : 1 + len(ticks)]] == [
        (record.topic, record.data) for record in ticks
    ]
    assert list(found.stream(5)) == stream[5:]


def test_its_offer_is_what_the_log_states(session: Callable[..., Path], ticks: list[RecordedMessage]) -> None:
    found = RecordedSession(session(schedule=STATED.to_dict()))
    offer = found.offer()
    assert (found.run, offer.run) == (RUN, RUN)
    assert offer.schedule == STATED.to_dict()
    assert offer.logs == [{"name": "session.mcap"}]
    assert offer.robot == {"toml": "[robot]", "urdf": "<robot/>"}
    assert offer.messages == 2 * (1 + len(ticks))


def test_epochs_may_be_given_and_must_be_where_the_log_states_none(session: Callable[..., Path]) -> None:
    assert RecordedSession(session(schedule=STATED.to_dict()), epochs=7).schedule == Schedule(7).to_dict()
    path = session()
    assert RecordedSession(path, epochs=7).schedule == Schedule(7).to_dict()
    with pytest.raises(LogError, match="does not state how many epochs the session had; give --epochs"):
        RecordedSession(path)


def test_topics_are_those_asked_for_or_stated(session: Callable[..., Path]) -> None:
    stated = {**STATED.to_dict(), "topics": list(REACHED_TICK)}
    found = RecordedSession(session(schedule=stated))
    assert found.schedule["topics"] == list(REACHED_TICK)
    assert not {record.topic for record in found.stream()} & {LEFT_TARGET}
    assert RecordedSession(session(schedule=stated), topics=COMMANDED_TICK).schedule == STATED.to_dict()


def test_what_a_log_states_of_topics(session: Callable[..., Path]) -> None:
    assert stated_topics(LogReader(session())) is None
    assert stated_topics(LogReader(session(schedule=STATED.to_dict()))) == COMMANDED_TICK
    stated = {**STATED.to_dict(), "topics": list(REACHED_TICK)}
    assert stated_topics(LogReader(session(schedule=stated))) == REACHED_TICK


def test_topics_of_others_are_renamed(session: Callable[..., Path]) -> None:
    path = session(left="/other", schedule=STATED.to_dict())
    topics = {record.topic for record in RecordedSession(path, renames={"/other": LEFT_TARGET}).stream()}
    assert topics == {SESSION_PHASE, *COMMANDED_TICK}


@pytest.mark.parametrize(("runs", "found"), [((), "none"), ((RUN, "cd" * 16), "those of 2")])
def test_markers_are_of_one_run(session: Callable[..., Path], runs: tuple[str, ...], found: str) -> None:
    path = session(runs=runs, schedule=STATED.to_dict())
    with pytest.raises(LogError, match=f"expected the phase markers of one recorded run, found {found}"):
        RecordedSession(path)


def test_a_marker_that_is_none_is_named(session: Callable[..., Path], tmp_path: Path) -> None:
    path = tmp_path / "wrong.mcap"
    with LogWriter(path, manifest={"schedule": STATED.to_dict()}) as writer:
        writer.write(SESSION_PHASE, String("no marker"), log_time_ns=0)
    with pytest.raises(MessageError, match=r"wrong\.mcap: "):
        RecordedSession(path)


def test_a_marker_is_a_text(tmp_path: Path) -> None:
    numbers = Float64MultiArray(np.zeros(1))
    odd = RecordedMessage(SESSION_PHASE, numbers.TYPE, encode(numbers), 0, 1)
    path = write_foreign(tmp_path / "wrong.mcap", [odd])
    with pytest.raises(LogError, match=rf"wrong\.mcap: {SESSION_PHASE} #0: expected {String.TYPE}, found '{odd.type}'"):
        RecordedSession(path, epochs=1)


def test_a_message_that_is_too_large_to_travel_is_refused_at_the_start(
    session: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = session(schedule=STATED.to_dict())
    largest = max(len(record.data) for record in RecordedSession(path).stream())
    monkeypatch.setattr(scheduled, "MAX_MESSAGE", largest)
    RecordedSession(path)
    monkeypatch.setattr(scheduled, "MAX_MESSAGE", largest - 1)
    with pytest.raises(LogError, match=f"expected at most {largest - 1} bytes in a message, found {largest}"):
        RecordedSession(path)


def test_joints_as_published_are_no_topic_of_it(session: Callable[..., Path]) -> None:
    found = {record.topic for record in RecordedSession(session(schedule=STATED.to_dict())).stream()}
    assert JOINT_STATES not in found
    assert LEARNER_OUTPUT not in found
