"""A log whose messages meet in their stamps goes on as it is, unless more is asked for or another has to be aligned."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab import MS, START, recording
from mcap.writer import Writer
from sessions import write_foreign

from pipeline.alignment.align import align_logs, carries_ticks
from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.robot.config import load_robot
from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.opening import open_log
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import ROBOT_DESCRIPTION, SAMPLE_JOINTS
from recorders.writing.writer import LogWriter

HAND, TARGET = "/hand/tip/measured", "/hand/tip/target"
REACHED, COMMANDED = (HAND, SAMPLE_JOINTS), (TARGET, SAMPLE_JOINTS)
POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
FILES = {"robot.toml": b"x", "robot.urdf": b"y"}


def at(topic: str, *stamps: int) -> list[RecordedMessage]:
    """Return messages of a topic at some stamps [ms]."""
    found = []
    for number, stamp in enumerate(stamps):
        ns = START + stamp * MS
        joints = topic == SAMPLE_JOINTS
        message = JointState(ns, ("a",), np.zeros(1)) if joints else PoseStamped(ns, np.zeros(3))
        found.append(RecordedMessage(topic, message.TYPE, encode(message), number, ns))
    return found


def carries(folder: Path, records: Sequence[RecordedMessage], tick: Sequence[str] = COMMANDED, **renames: str) -> bool:
    log = write_foreign(folder / "log.mcap", sorted(records, key=lambda record: record.log_time_ns))
    return carries_ticks(open_log(log), {f"/{foreign}": ours for foreign, ours in renames.items()}, tick)


@pytest.mark.parametrize(
    ("targets", "joints", "meet"),
    [
        ((0, 10, 20), (0, 10, 20), True),
        ((0,), (0,), True),
        ((0,), (5,), False),
        ((), (0,), True),  # the learner names what is missing
        ((0, 10), (), False),
        ((0, 10, 20), (0, 10), True),  # cut off within a tick
        ((0, 10), (0, 15), True),
        ((0, 10, 20, 30), (0,), False),
        ((0, 10, 20), (0, 11), False),
        ((0, 10, 20), (1, 11, 21), False),
    ],
)
def test_messages_meet_if_all_but_few_have_one_of_each_topic_at_their_stamp(
    tmp_path: Path, targets: tuple[int, ...], joints: tuple[int, ...], meet: bool
) -> None:
    assert carries(tmp_path, [*at(TARGET, *targets), *at(SAMPLE_JOINTS, *joints)]) == meet


def test_hands_as_measured_may_come_more_often_than_ticks(tmp_path: Path) -> None:
    more = [*at(HAND, *range(0, 100, 5)), *at(SAMPLE_JOINTS, *range(0, 100, 10))]
    assert carries(tmp_path, more, REACHED)
    assert not carries(tmp_path, [*at(HAND, 0, 5, 9), *at(SAMPLE_JOINTS, 1)], REACHED)
    assert not carries(tmp_path, [*at(HAND, 0, 5, 10), *at(SAMPLE_JOINTS, 0, 1, 2, 3)], REACHED)


def test_a_hand_as_measured_with_joints_but_without_the_other_hand_is_no_whole_tick(tmp_path: Path) -> None:
    tick = (HAND, "/hand/other/measured", SAMPLE_JOINTS)
    records = [*at(HAND, *range(4)), *at(SAMPLE_JOINTS, *range(4))]
    assert carries(tmp_path, [*records, *at(tick[1], 0, 1)], tick)
    assert not carries(tmp_path, [*records, *at(tick[1], 0)], tick)


def test_topics_are_renamed_before_and_names_that_are_not_there_count_for_nothing(tmp_path: Path) -> None:
    records = [*at("/teleop", 0, 10), *at(SAMPLE_JOINTS, 0, 10)]
    assert carries(tmp_path, records)  # it has our joints
    assert carries(tmp_path, records, teleop=TARGET, nowhere=HAND)
    apart = [*at("/teleop", 0, 10, 20), *at(SAMPLE_JOINTS, 1, 11, 21)]
    assert not carries(tmp_path, apart, teleop=TARGET, nowhere=HAND)
    log = open_log(write_foreign(tmp_path / "moved.mcap", records))
    assert not carries_ticks(log, {SAMPLE_JOINTS: "/aside"}, COMMANDED)


def test_what_cannot_be_read_is_left_to_the_learner(tmp_path: Path) -> None:
    apart = [*at(TARGET, 0, 10, 20), *at(SAMPLE_JOINTS, 1, 11, 21)]
    assert carries(tmp_path, [apart[0]._replace(data=b"\0\1\0\0cut"), *apart[1:]])


def test_messages_without_a_stamp_meet_none_with_one(tmp_path: Path) -> None:
    notes = [RecordedMessage("/tip", String.TYPE, encode(String("x")), 0, START + t * MS) for t in range(3)]
    log = open_log(write_foreign(tmp_path / "log.mcap", [*notes, *at(SAMPLE_JOINTS, 5, 15)]))
    assert not carries_ticks(log, {}, ("/tip", SAMPLE_JOINTS))


@pytest.mark.parametrize(
    ("manifest", "files", "meets"),
    [
        ({"kind": "exploration"}, FILES, True),
        ({"note": 1}, FILES, True),
        ({"kind": "recording"}, FILES, False),
        ({"kind": "exploration"}, {"robot.toml": b"x"}, False),
        ({}, FILES, True),
    ],
)
def test_a_log_of_ours_with_its_robot_is_one_of_ticks_unless_it_is_a_recording(
    tmp_path: Path, manifest: dict[str, Any], files: dict[str, bytes], meets: bool
) -> None:
    with LogWriter(tmp_path / "ours.mcap", manifest=manifest, attachments=files) as writer:
        for record in [*at(TARGET, 0, 10, 20), *at(SAMPLE_JOINTS, 1, 11, 21)]:
            writer.copy(record)
    reader = open_log(tmp_path / "ours.mcap")
    assert carries_ticks(reader, {}, COMMANDED) == meets


def test_a_log_of_others_that_has_a_robot_is_looked_into(tmp_path: Path) -> None:
    log = tmp_path / "theirs.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for name, data in FILES.items():
            writer.add_attachment(0, 0, name, "text/plain", data)
        for topic, stamp in ((TARGET, 0), (SAMPLE_JOINTS, 1), (TARGET, 10), (SAMPLE_JOINTS, 11)):
            (record,) = at(topic, stamp)
            schema = writer.register_schema(record.type, "ros2msg", schema_text(record.type).encode())
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, record.log_time_ns, record.data, record.log_time_ns)
        writer.finish()
    assert set(open_log(log).attachments) == set(FILES)
    assert not carries_ticks(open_log(log), {}, COMMANDED)


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A log that carries ticks of the hand as measured."""
    return write_foreign(tmp_path / "whole.mcap", [*at(HAND, 0, 10), *at(SAMPLE_JOINTS, 0, 10)])


def test_logs_that_all_carry_ticks_are_as_they_were(whole: Path, log: Path, robot: Path) -> None:
    options = {"robot": load_robot(robot), "tick": REACHED}
    mapped = {"/tracker": HAND}
    assert align_logs([whole], AlignmentConfig(), renames={"/a": "/b"}, **options) == ([whole], {"/a": "/b"})
    found, renames = align_logs([log, log], AlignmentConfig(), renames=mapped, **options)
    assert [type(part) for part in found] == [AlignedLog] * 2
    assert renames == {}
    (one,), _ = align_logs([log], AlignmentConfig(clock="header"), renames=mapped, **options)
    assert isinstance(one, AlignedLog)
    assert list(one) == list(found[0])
    with pytest.raises(LogError, match="expected"):  # one that is not makes all of them be aligned
        align_logs([log, whole], AlignmentConfig(), renames=mapped, **options)
    with pytest.raises(LogError, match="expected"):
        align_logs([whole], AlignmentConfig(clock="header"), renames={}, **options)


def test_a_robot_is_given_or_carried(log: Path, robot: Path, tmp_path: Path) -> None:
    mapped, files = {"/tracker": HAND}, {name: (robot / name).read_bytes() for name in FILES}
    with pytest.raises(ConfigError, match="carries no robot, whose joints are to be aligned; give one with --robot"):
        align_logs([log], AlignmentConfig(), robot=None, renames=mapped, tick=REACHED)
    description = RecordedMessage(ROBOT_DESCRIPTION, String.TYPE, encode(String("<robot/>")), 0, START)
    described = write_foreign(tmp_path / "described.mcap", [description, *recording(robot)])
    for theirs, made in ((log, False), (described, True)):
        with pytest.raises(ConfigError) as error:
            align_logs([theirs], AlignmentConfig(), robot=None, renames=mapped, tick=REACHED)
        assert str(error.value).endswith("is a URDF, of which `reenact robot new` makes one") == made
    with LogWriter(tmp_path / "ours.mcap", manifest={"kind": "recording"}, attachments=files) as writer:
        for record in recording(robot):
            writer.copy(record)
    (ours,), _ = align_logs([tmp_path / "ours.mcap"], AlignmentConfig(), robot=None, renames=mapped, tick=REACHED)
    (plain,), _ = align_logs([log], AlignmentConfig(), robot=load_robot(robot), renames=mapped, tick=REACHED)
    assert isinstance(ours, AlignedLog)
    assert isinstance(plain, AlignedLog)
    assert list(ours) == list(plain)


@pytest.mark.parametrize(
    ("config", "renames", "line"),
    [
        (
            {"latencies_ns": {"/x": 1}},
            {},
            "--latency: expected a topic /x, found none; there are: /joint_states, /tracker",
        ),
        ({"frames": {"/x": POSE}}, {}, "--frame: expected a topic /x, found none"),
        ({"offsets": {"/x": POSE, "/tracker": POSE}}, {}, "--offset: expected a topic /x, found none"),
        ({}, {"/x": HAND}, "--map: expected a topic /x, found none"),
    ],
)
def test_options_for_topics_that_are_not_there_are_refused(
    log: Path, robot: Path, config: Any, renames: dict[str, str], line: str
) -> None:
    with pytest.raises((ConfigError, LogError)) as error:
        align_logs([log], AlignmentConfig(**config), robot=load_robot(robot), renames=renames, tick=REACHED)
    assert line in str(error.value)
