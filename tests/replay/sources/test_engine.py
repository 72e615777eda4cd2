"""The scheduled presents logs as the schedule says, and can begin at any message."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest
from episodes import write_episode
from sessions import write_foreign

from recorders.cdr.codec import decode, encode
from recorders.errors import LogError, MessageError
from recorders.messages.message_types import JointState, Message, String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    JOINT_STATES,
    LEARNER_TOPICS,
    LEFT_TARGET,
    RIGHT_TARGET,
    ROBOT_TEXTS,
    SAMPLE_JOINTS,
    SESSION_PHASE,
)
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources import scheduled
from replay.sources.schedule import Schedule
from replay.sources.scheduled import EpisodeLog, Replay, naming, read_robot, renamed

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


def test_of_several_logs_each_is_kept_that_is_small(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    large = write_episode(tmp_path / "large.mcap", samples=9)
    monkeypatch.setattr(scheduled, "CACHE_BYTES", sum(len(record.data) for record in LogReader(log)))
    replay = Replay([log, large], SCHEDULE)
    assert [episode.retained for episode in replay.episodes] == [True, False]
    assert not replay.retained


def test_presentations_before_the_first_message_are_not_read(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one ends and the next begins, only the next one is."""
    read: list[int] = []

    def presented(episode: EpisodeLog) -> Iterator[RecordedMessage]:
        read.append(episode.count)
        return iter(LogReader(log))

    replay = Replay([log], SCHEDULE)
    whole = list(replay.stream())
    monkeypatch.setattr(EpisodeLog, "__iter__", presented)
    for start, often in ((0, 6), (15, 6), (16, 5), (17, 5), (80, 1), (95, 1), (96, 0)):
        read.clear()
        assert list(replay.stream(start)) == whole[start:]
        assert len(read) == often


def test_a_run_has_a_name_of_128_bits(log: Path) -> None:
    assert len(bytes.fromhex(Replay([log], SCHEDULE).run)) == 16


def test_no_log_is_an_error() -> None:
    with pytest.raises(LogError, match="expected at least one log, found none"):
        Replay([], SCHEDULE)


def test_a_message_that_is_too_large_to_travel_is_refused_at_the_start(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    largest = max(len(record.data) for record in LogReader(log))
    monkeypatch.setattr(scheduled, "MAX_MESSAGE", largest)
    assert len(Replay([log], SCHEDULE).episodes) == 1
    monkeypatch.setattr(scheduled, "MAX_MESSAGE", largest - 1)
    with pytest.raises(LogError, match=rf"log\.mcap: .*expected at most {largest - 1} bytes .*, found {largest}"):
        Replay([log], SCHEDULE)


def test_a_topic_is_renamed_to_one_of_its_type_or_has_none(tmp_path: Path) -> None:
    joints = JointState(1, ("a",), [0.0])
    for kind in (joints.TYPE, ""):
        path = write_foreign(tmp_path / "log.mcap", [RecordedMessage("/arm", kind, encode(joints), 0, 1)])
        (found,) = renamed(LogReader(path), {"/arm": SAMPLE_JOINTS}, {SAMPLE_JOINTS})
        assert (found.topic, found.type) == (SAMPLE_JOINTS, joints.TYPE)
        (found,) = renamed(LogReader(path), {}, {"/arm"})
        assert found.type == kind
    path = write_foreign(tmp_path / "log.mcap", [RecordedMessage("/arm", joints.TYPE, encode(joints), 0, 1)])
    with pytest.raises(LogError, match=rf"--map /arm={LEFT_TARGET}: expected a topic of .*PoseStamped, found one of '"):
        list(renamed(LogReader(path), {"/arm": LEFT_TARGET}, {LEFT_TARGET}))


def test_a_robot_is_text(tmp_path: Path) -> None:
    path = write_episode(
        tmp_path / "odd.mcap", samples=2, attachments={"robot.urdf": b"<robot/>", "robot.toml": b"\xff"}
    )
    with pytest.raises(LogError, match=r"odd\.mcap: expected the robot's files to be UTF-8 text, found other bytes"):
        Replay([path], SCHEDULE)


def robot_texts(path: Path, *texts: tuple[str, bytes]) -> LogReader:
    """Write a log of what a robot published of itself, and open it."""
    found = [RecordedMessage(ROBOT_TEXTS[text], String.TYPE, data, 0, at) for at, (text, data) in enumerate(texts)]
    return LogReader(write_foreign(path, found))


def test_a_robot_without_files_is_what_it_published_of_itself_last(tmp_path: Path) -> None:
    toml, urdf = ([encode(String(text)) for text in texts] for texts in (("[old]", "[robot]"), ("<robot/>",)))
    both = robot_texts(tmp_path / "both.mcap", ("toml", toml[0]), ("urdf", urdf[0]), ("toml", toml[1]))
    assert read_robot(both) == {"toml": "[robot]", "urdf": "<robot/>"}
    assert read_robot(robot_texts(tmp_path / "one.mcap", ("urdf", urdf[0]))) == {}


def test_what_a_robot_published_of_itself_and_is_no_message_is_named(tmp_path: Path) -> None:
    log = robot_texts(tmp_path / "odd.mcap", ("toml", encode(String("[robot]"))), ("urdf", b""))
    with pytest.raises(LogError, match=rf"odd\.mcap: {ROBOT_TEXTS['urdf']}: "):
        read_robot(log)


@pytest.mark.parametrize(
    ("times_ns", "ours", "named"), [((5, 5, 7), False, False), ((5, 7, 6), False, True), ((5, 7, 6), True, False)]
)
def test_what_is_wrong_with_a_message_names_the_log_and_that_its_times_fall(
    tmp_path: Path, times_ns: tuple[int, ...], ours: bool, named: bool
) -> None:
    """Unless the log is one of ours, whose messages go by the file anyway."""
    path = tmp_path / "log.mcap"
    if ours:
        with LogWriter(path, manifest={}) as writer:
            for time_ns in times_ns:
                writer.write("/a", String("x"), log_time_ns=time_ns)
    else:
        write_foreign(path, [RecordedMessage("/a", "", b"\0\1\0\0", 0, time_ns) for time_ns in times_ns])
    with pytest.raises(MessageError) as error, naming(path):
        raise MessageError("odd")
    assert str(error.value).startswith(f"{path}: odd")
    assert ("log times fall in the order of the file" in str(error.value)) == named
    path.unlink()
    with pytest.raises(MessageError, match=r"log\.mcap: odd$"), naming(path):
        raise MessageError("odd")


def test_markers_have_no_time_of_their_own(log: Path) -> None:
    markers = [message for message in Replay([log], SCHEDULE).stream() if message.topic == SESSION_PHASE]
    assert {marker.log_time_ns for marker in markers} == {0}
