"""The scheduled presents logs as the schedule says, and can begin at any message."""

from itertools import islice
from pathlib import Path

import pytest
from episodes import write_episode

from recorders.cdr.codec import decode
from recorders.errors import LogError, MessageError
from recorders.messages.message_types import Message, String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    JOINT_STATES,
    LEARNER_TOPICS,
    LEFT_TARGET,
    RIGHT_TARGET,
    SAMPLE_JOINTS,
    SESSION_PHASE,
)
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources import scheduled
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay, renamed

SCHEDULE = Schedule(epochs=2, phases=(("washout", 1), ("learn", 2)))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("engine") / "log.mcap", samples=4)


def phase_of(message: RecordedMessage) -> Phase:
    marker = decode(message.type, message.data)
    assert isinstance(marker, String)
    return Phase.from_message(marker)


def test_every_cycle_is_a_marker_and_the_whole_log(log: Path) -> None:
    replay = Replay([log], SCHEDULE)
    messages = list(replay.stream())
    assert len(messages) == len(replay) == 2 * 3 * (1 + 15)
    markers = [message for message in messages if message.topic == SESSION_PHASE]
    assert [(phase_of(marker).epoch, phase_of(marker).cycle, phase_of(marker).phase) for marker in markers] == [
        (epoch, cycle, phase) for epoch in range(2) for cycle, phase in enumerate(["washout", "learn", "learn"])
    ]
    assert [marker.sequence for marker in markers] == list(range(6))
    cycles = [messages[1 + 16 * cycle : 16 * (cycle + 1)] for cycle in range(6)]
    assert all(cycle == cycles[0] for cycle in cycles)


def test_several_logs_are_presented_in_turn(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "other.mcap", samples=2)
    messages = list(Replay([log, other], SCHEDULE).stream())
    markers = [phase_of(message) for message in messages if message.topic == SESSION_PHASE]
    assert len(markers) == 12
    assert len({marker.log for marker in markers}) == 2
    assert [marker.cycle for marker in markers[:4]] == [0, 0, 1, 1]


def test_it_begins_at_any_message(log: Path) -> None:
    replay = Replay([log], SCHEDULE)
    whole = list(replay.stream())
    for start in range(len(whole) + 1):
        assert list(replay.stream(start)) == whole[start:]


def test_a_log_too_large_to_keep_gives_the_same_stream(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = list(Replay([log], SCHEDULE).stream())
    monkeypatch.setattr(scheduled, "CACHE_BYTES", 100)
    assert list(Replay([log], SCHEDULE).stream()) == kept


def test_the_stream_is_lazy(log: Path) -> None:
    forever = Schedule(epochs=1_000_000)
    assert len(list(islice(Replay([log], forever).stream(), 100))) == 100


def test_the_run_names_the_content(log: Path, tmp_path: Path) -> None:
    same = write_episode(tmp_path / "same.mcap", samples=4)
    other = write_episode(tmp_path / "other.mcap", samples=5)
    run = Replay([log], SCHEDULE).run
    assert Replay([same], SCHEDULE).run == run
    assert Replay([other], SCHEDULE).run != run
    assert Replay([log], Schedule(epochs=3)).run != run


def test_a_log_without_joints_is_refused(tmp_path: Path) -> None:
    path = write_episode(
        tmp_path / "log.mcap",
        change=lambda tick, topic, message: [(JOINT_STATES if topic == SAMPLE_JOINTS else topic, message)],
    )
    with pytest.raises(LogError, match=r"expected messages on /sample/joint_states, found none"):
        Replay([path], SCHEDULE)


@pytest.mark.parametrize("lost", [topic.name for topic in LEARNER_TOPICS])
def test_a_log_that_ends_within_a_tick_is_refused(tmp_path: Path, lost: str) -> None:
    path = write_episode(
        tmp_path / "log.mcap",
        samples=4,
        change=lambda tick, topic, message: [] if tick == 4 and topic == lost else [(topic, message)],
    )
    with pytest.raises(MessageError, match=rf"log.mcap: the tick at 800000000 ns lacks {lost}.* the cycle is over"):
        Replay([path], SCHEDULE)


def test_a_recorded_session_is_no_episode(log: Path, tmp_path: Path) -> None:
    """Its markers would be lost, and its cycles run into one another."""
    with LogWriter(tmp_path / "session.mcap", manifest={}) as writer:
        for record in islice(Replay([log], SCHEDULE).stream(), 16):
            writer.copy(record)
    with pytest.raises(LogError, match=r"session.mcap: a recorded session, with phase markers .* use --as-recorded"):
        Replay([tmp_path / "session.mcap"], SCHEDULE)


def test_only_topics_that_can_still_be_renamed_are_offered(tmp_path: Path) -> None:
    theirs = {LEFT_TARGET: "/their/left", RIGHT_TARGET: "/their/right", SAMPLE_JOINTS: "/their/joints"}

    def change(tick: int, topic: str, message: Message) -> list[tuple[str, Message]]:
        return [(theirs[topic], message), *([("/their/words", String("x"))] if topic == LEFT_TARGET else [])]

    path = write_episode(tmp_path / "log.mcap", samples=2, change=change)
    mapped = {"/their/left": LEFT_TARGET}
    with pytest.raises(LogError) as caught:
        Replay([path], SCHEDULE, renames=mapped)
    assert str(caught.value).endswith(
        "log.mcap: expected messages on /hand/right/target, /sample/joint_states, found none; record with explore, "
        "or rename with --map one of /their/joints, /their/right"
    )
    with pytest.raises(LogError, match=r"found none; record with explore, or rename with --map one of /their/right$"):
        Replay([path], SCHEDULE, renames=mapped | {"/their/joints": SAMPLE_JOINTS})
    slip = {theirs[topic]: topic for topic in theirs} | {"/their/wrods": "/any"}
    with pytest.raises(LogError, match=r"expected a topic /their/wrods, found none; there are: /their/words$"):
        Replay([path], SCHEDULE, renames=slip)
    with pytest.raises(LogError, match=r"record with explore; it has no other topic to rename$"):
        Replay([path], SCHEDULE, renames=mapped | {"/their/right": SAMPLE_JOINTS, "/their/joints": SAMPLE_JOINTS})


def test_logs_of_different_robots_are_refused(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "other.mcap", attachments={"robot.urdf": b"<robot/>", "robot.toml": b""})
    with pytest.raises(LogError, match="another robot"):
        Replay([log, other], SCHEDULE)


def test_a_name_that_no_log_has_cannot_be_replaced(log: Path, tmp_path: Path) -> None:
    other = write_episode(
        tmp_path / "other.mcap", samples=2, change=lambda tick, topic, message: [("/theirs" + topic, message)]
    )
    names = {"/theirs" + topic.name: topic.name for topic in LEARNER_TOPICS}
    assert len(Replay([log, other], SCHEDULE, renames=names).episodes) == 2  # one of them has it
    found = r"log.mcap: --map: expected a topic /slip, found none; there are: /hand/left/target, .*/joint_states$"
    with pytest.raises(LogError, match=found):
        Replay([log], SCHEDULE, renames={"/slip": "/elsewhere"})
    with pytest.raises(LogError, match=found):
        list(renamed(LogReader(log), {"/slip": "/elsewhere"}, {SAMPLE_JOINTS}))


def test_however_many_topics_a_log_has_they_are_listed_as_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Making the list takes as long as it is: asked for once a topic, 65,000 of them take minutes."""
    listed: list[Path] = []

    def counted(reader: LogReader) -> dict[str, str]:
        listed.append(reader.path)
        return {channel.topic: channel.type for channel in reader.channels}

    monkeypatch.setattr(LogReader, "topics", property(counted))
    often = []
    for count in (3, 300):
        path = tmp_path / f"{count}.mcap"
        with LogWriter(path, manifest={}) as writer:
            for number in range(count):
                writer.write(f"/topic/{number}", String("x"), log_time_ns=number)
        listed.clear()
        with pytest.raises(LogError, match=r"found none; record with explore; it has no other topic to rename"):
            Replay([path], SCHEDULE)
        often.append(len(listed))
    assert often[0] == often[1]


def test_a_small_log_is_read_once_and_a_large_one_every_time(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    records = list(LogReader(log))
    size = sum(len(record.data) for record in records)
    assert scheduled.CACHE_BYTES == 64 * 1024 * 1024
    for limit, retained in ((size, True), (size - 1, False)):
        monkeypatch.setattr(scheduled, "CACHE_BYTES", limit)
        replay = Replay([log], SCHEDULE)
        assert (replay.retained, replay.episodes[0].retained) == (retained, retained)
        assert list(replay.episodes[0]) == list(replay.episodes[0]) == records


def test_markers_have_no_time_of_their_own(log: Path) -> None:
    markers = [message for message in Replay([log], SCHEDULE).stream() if message.topic == SESSION_PHASE]
    assert {marker.log_time_ns for marker in markers} == {0}
