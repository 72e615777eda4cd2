"""A log that is aligned reads as any log does: spans, topics, counts, channels, phases, and the robot's files."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab import MS, START, holed
from sessions import write_foreign

from pipeline.alignment import aligned_log, ticks
from pipeline.alignment.aligned_log import AlignedLog, own_frames, write_episodes
from pipeline.alignment.aligned_session import AlignedSession
from pipeline.alignment.config import AlignmentConfig
from pipeline.robot.config import load_robot
from recorders.cdr.codec import decode, encode
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.opening import open_log
from recorders.errors import LogError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

HAND = "/hand/tip/measured"
TYPES = {HAND: PoseStamped.TYPE, SAMPLE_JOINTS: JointState.TYPE}


def ticks_of(log: Path, robot: Path, config: AlignmentConfig | None = None) -> AlignedLog:
    options = {"config": config or AlignmentConfig(), "renames": {"/tracker": HAND}, "wanted": (HAND, SAMPLE_JOINTS)}
    return AlignedLog(open_log(log), load_robot(robot), **options)


def moving(robot: Path, *steps: int, log_ms: int = 0) -> list[RecordedMessage]:
    """Return messages of the hand and the joints at some multiples of 10 ms, both farther along with each."""
    names, found = load_robot(robot).joints, []
    for place, step in enumerate(steps):
        stamp, at = START + step * 10 * MS, START + (log_ms + place * 10) * MS
        joints = JointState(stamp, names, np.full(len(names), 0.1 * step))
        pose = PoseStamped(stamp, np.array([0.01 * step, 0.0, 0.0]))
        found += [RecordedMessage("/tracker", pose.TYPE, encode(pose), place, at)]
        found += [RecordedMessage("/joint_states", joints.TYPE, encode(joints), place, at + 1)]
    return found


def marker(number: int, log_ms: int) -> RecordedMessage:
    message = Phase("lab", 0, number, LEARN, log="").to_message()
    return RecordedMessage(SESSION_PHASE, message.TYPE, encode(message), number, START + log_ms * MS)


def test_spans_and_topics_of_it_are_those_of_all_its_messages(log: Path, robot: Path) -> None:
    read = ticks_of(log, robot)
    every = list(read)
    assert len(every) == 2 * 240
    stamps = [START, *(every[place].log_time_ns + more for place in (0, 100, 301, -1) for more in (0, 1))]
    for start_ns, end_ns in product(stamps, repeat=2):
        there = [record for record in every if start_ns <= record.log_time_ns < end_ns]
        assert list(read.records(start_ns=start_ns, end_ns=end_ns, file_order=True)) == there
        hands = read.records(topics=iter([HAND, "/other"]), start_ns=start_ns, end_ns=end_ns)
        assert list(hands) == [record for record in there if record.topic == HAND]
    assert list(read.records(topics=[])) == []


def test_it_is_described_as_any_log(log: Path, robot: Path) -> None:
    read = ticks_of(log, robot)
    assert (read.path, read.by_file, read.protected, read.source_manifest) == (log, True, True, {})
    assert (list(read.topics.items()), read.counts) == (list(TYPES.items()), dict.fromkeys(TYPES, 240))
    declared = [(c.topic, c.encoding, c.schema) for c in read.channels]
    assert declared == [(name, "cdr", (kind, "ros2msg", schema_text(kind).encode())) for name, kind in TYPES.items()]
    assert read.manifest == {"alignment": read.summary.to_dict()}
    files = {name: (robot / name).read_bytes() for name in ("robot.toml", "robot.urdf")}
    assert {name: read.attachment(name) for name in read.attachments} == files
    with pytest.raises(LogError, match=r"no attachment 'x'; there are: robot\.toml, robot\.urdf"):
        read.attachment("x")


def test_poses_are_in_the_world_by_its_names(robot: Path) -> None:
    assert own_frames(load_robot(robot)) == ("", "world", "world")


def test_a_phase_has_the_time_of_the_tick_that_follows_it(robot: Path, tmp_path: Path) -> None:
    """Before the first, two between, and after the last; a cycle goes on from where the one before ended."""
    records = [
        marker(0, 0),
        *moving(robot, 0, 1, 2, log_ms=1),
        marker(1, 40),
        marker(2, 41),
        *moving(robot, 3, 4, log_ms=42),
        marker(3, 90),
    ]
    read = ticks_of(write_foreign(tmp_path / "phases.mcap", records), robot)
    assert [phase.log_time_ns - START for phase in read.phases] == [0, 30 * MS, 30 * MS, 40 * MS + 1]
    assert [phase.data for phase in read.phases] == [record.data for record in records if record.topic == SESSION_PHASE]
    assert (read.summary.made, read.summary.episodes, read.summary.restarts) == (5, 2, 0)
    assert [record.sequence for record in read.records(topics=[HAND])] == [0, 1, 2, 4, 5]


@pytest.fixture
def session(robot: Path, tmp_path: Path) -> AlignedSession:
    """Five ticks from time 0 on, with markers before the first, two between, and one after the last."""
    records = [
        marker(0, 0),
        *moving(robot, 0, 1, 2, log_ms=1),
        *(marker(number, 39 + number) for number in (1, 2)),
        *moving(robot, 3, 4, log_ms=42),
        marker(3, 90),
    ]
    latencies = dict.fromkeys(("/tracker", "/joint_states"), START)
    log = write_foreign(tmp_path / "phases.mcap", records)
    return AlignedSession(ticks_of(log, robot, AlignmentConfig(latencies_ns=latencies)))


def test_a_session_is_the_ticks_with_each_marker_before_the_tick_that_followed_it(session: AlignedSession) -> None:
    tick, every = [HAND, SAMPLE_JOINTS], list(session)
    expected = [SESSION_PHASE, *tick * 3, SESSION_PHASE, SESSION_PHASE, *tick * 2, SESSION_PHASE]
    assert [record.topic for record in every] == expected
    assert [record.log_time_ns // MS for record in every] == [0, 0, 0, 10, 10, 20, 20, *[30] * 4, 40, 40, 40]
    for start_ns, end_ns in product([0, 1, 30 * MS, 30 * MS + 1, 40 * MS + 1, 40 * MS + 2], repeat=2):
        there = [record for record in every if start_ns <= record.log_time_ns < end_ns]
        assert list(session.records(start_ns=start_ns, end_ns=end_ns, file_order=True)) == there
    for topics in ([SESSION_PHASE], [HAND], [HAND, SESSION_PHASE, "/other"], []):
        there = [record for record in every if record.topic in topics]
        assert list(session.records(topics=iter(topics))) == there


def test_a_session_is_described_as_any_log(session: AlignedSession) -> None:
    assert list(session.topics.items()) == [(SESSION_PHASE, String.TYPE), *TYPES.items()]
    assert session.counts == {SESSION_PHASE: 4, HAND: 5, SAMPLE_JOINTS: 5}
    schema = (String.TYPE, "ros2msg", schema_text(String.TYPE).encode())
    first, *others = [(channel.topic, channel.encoding, channel.schema) for channel in session.channels]
    assert first == (SESSION_PHASE, "cdr", schema)
    assert [topic for topic, _, _ in others] == list(TYPES)


@pytest.mark.parametrize(("schedule", "stated"), [({"epochs": 2}, True), ("two", False)])
def test_a_session_has_the_schedule_of_its_log(robot: Path, tmp_path: Path, schedule: Any, stated: bool) -> None:
    with LogWriter(tmp_path / "log.mcap", manifest={"schedule": schedule, "seed": 3}) as writer:
        for record in moving(robot, 0, 1, 2):
            writer.copy(record)
    session = AlignedSession(read := ticks_of(tmp_path / "log.mcap", robot))
    assert session.manifest == read.manifest | ({"schedule": schedule} if stated else {})


@pytest.mark.parametrize(("first", "fine"), [(3, True), (2, False), (1, False)])
def test_a_cycle_begins_after_the_tick_before_it(robot: Path, tmp_path: Path, first: int, fine: bool) -> None:
    records = [*moving(robot, 0, 1, 2), marker(0, 40), *moving(robot, first, first + 1, log_ms=42)]
    log = write_foreign(tmp_path / "again.mcap", records)
    if fine:
        assert ticks_of(log, robot).summary.episodes == 2
    else:
        with pytest.raises(LogError, match="found a clock that began anew"):
            ticks_of(log, robot)


def test_more_phase_markers_than_any_session_has_are_refused(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert 10**5 < ticks.MOST_PHASES < 10**6
    for module in (aligned_log, ticks):
        monkeypatch.setattr(module, "MOST_PHASES", 3)
    for count in (2, 3, 4):
        markers = [marker(number, number) for number in range(count)]
        log = write_foreign(tmp_path / "many.mcap", [*markers, *moving(robot, 0, 1, 2, log_ms=50)])
        if count == 2:
            assert len(ticks_of(log, robot).phases) == 2
        else:
            with pytest.raises(LogError, match="expected fewer than 3 phase markers, found more"):
                ticks_of(log, robot)


def test_episodes_are_written_each_as_a_log_of_ours(robot: Path, tmp_path: Path) -> None:
    read = ticks_of(holed(robot, tmp_path / "holed.mcap"), robot)
    paths = write_episodes(read, tmp_path / "episodes")
    assert paths == [tmp_path / "episodes" / name for name in ("holed.mcap", "holed_1.mcap")]
    written = [LogReader(path) for path in paths]
    assert [record.data for part in written for record in part] == [record.data for record in read]
    ends = [[record.log_time_ns for record in part] for part in written]
    assert ends[0][-1] < START + 3 * 10**9 < START + 4 * 10**9 < ends[1][0]
    for part in written:
        assert part.manifest["alignment"] == read.manifest["alignment"]
        assert {name: part.attachment(name) for name in part.attachments} == {
            name: read.attachment(name) for name in read.attachments
        }


def test_a_tick_may_be_at_time_0(robot: Path, tmp_path: Path) -> None:
    log = write_foreign(tmp_path / "log.mcap", moving(robot, 0, 1, 2))
    read = ticks_of(log, robot, AlignmentConfig(latencies_ns=dict.fromkeys(("/tracker", "/joint_states"), START)))
    assert [record.log_time_ns for record in read.records(topics=[HAND])] == [0, 10 * MS, 20 * MS]


def test_what_is_wrong_with_a_log_names_it(robot: Path, tmp_path: Path) -> None:
    log = write_foreign(tmp_path / "still.mcap", [moving(robot, 0)[1], moving(robot, 100, log_ms=50)[0]])
    with pytest.raises(LogError, match=r"still\.mcap: expected"):
        ticks_of(log, robot)


@pytest.mark.parametrize("block", [1, 3, 8192])
def test_how_many_messages_are_read_at_a_time_changes_nothing(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    log = write_foreign(tmp_path / "log.mcap", moving(robot, *range(20)))
    monkeypatch.setattr(aligned_log, "_BLOCK", block)
    hands = [decode(record.type, record.data) for record in ticks_of(log, robot).records(topics=[HAND])]
    assert [hand.stamp_ns for hand in hands if isinstance(hand, PoseStamped)] == [
        START + step * 10 * MS for step in range(20)
    ]
