"""Logs compared by value: fields and topics left out, numbers within a tolerance; nothing else passes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from episodes import write_episode
from hypothesis import given, settings
from hypothesis import strategies as st
from sessions import write_foreign

from pipeline.cli.logs.diff_files import DiffConfig, diff
from recorders.cdr.codec import decode, encode
from recorders.cdr.rosbags_types import to_rosbags, typestore
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from replay.diff.divergence import Divergence, first_divergence
from replay.diff.rules import Rules, known_fields


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedMessage]:
    return list(LogReader(write_episode(tmp_path_factory.mktemp("rules") / "log.mcap", samples=6)))


def altered(record: RecordedMessage, **fields: object) -> RecordedMessage:
    message = decode(record.type, record.data)
    assert isinstance(message, JointState | PoseStamped)
    return record._replace(data=encode(replace(message, **fields)))


def each(log: list[RecordedMessage], change: Callable[[RecordedMessage], RecordedMessage]) -> list[RecordedMessage]:
    return [change(record) for record in log]


def test_numbers_of_another_writer_do_not_count_if_they_are_ignored(log: list[RecordedMessage]) -> None:
    other = [record._replace(sequence=place) for place, record in enumerate(log)]
    assert first_divergence(log, other) is not None
    assert first_divergence(log, other, Rules(("sequence",))) is None
    dropped = [*other[:7], *other[8:]]
    found = first_divergence(log, dropped, Rules(("sequence",)))
    assert found is not None
    assert (found.topic, found.stamp_ns) == (log[7].topic, 400_000_000)


def test_a_field_is_named_as_in_the_finding_or_by_its_beginning(log: list[RecordedMessage]) -> None:
    def moved(record: RecordedMessage) -> RecordedMessage:
        if record.topic != SAMPLE_JOINTS:
            return record
        joints = decode(record.type, record.data)
        assert isinstance(joints, JointState)
        position = joints.position.copy()
        position[3] += 1.0
        return altered(record, position=position, effort=[1.0] * len(position), frame_id="world")

    other = each(log, moved)
    for ignored in (("position", "effort", "header"), ("position[3]", "effort*", "header.frame_id")):
        assert first_divergence(log, other, Rules(ignored)) is None
    partly: tuple[tuple[tuple[str, ...], str], ...] = (
        (("position", "effort"), "header.frame_id"),
        (("position[2]", "effort", "header"), "position[3] (hip_roll)"),
        (("position", "header"), "effort[0] (hip_height)"),
    )
    for names, expected in partly:
        found = first_divergence(log, other, Rules(names))
        assert found is not None
        assert found.field == expected


@settings(max_examples=30)
@given(off=st.floats(0.0, 1.0), tolerance=st.floats(0.0, 1.0))
def test_numbers_may_be_apart_as_far_as_is_said_and_no_farther(off: float, tolerance: float) -> None:
    poses = [encode(PoseStamped(7, [x, 0.0, 0.0])) for x in (0.0, off)]
    a, b = ([RecordedMessage(LEFT_TARGET, PoseStamped.TYPE, data, 0, 0)] for data in poses)
    found = first_divergence(a, b, Rules(tolerance=tolerance))
    assert (found is None) == (off <= tolerance)
    if found is not None:
        assert (found.kind, found.field) == ("changed", "pose.position.x")


def test_nan_is_as_far_from_a_number_as_can_be_and_not_from_itself() -> None:
    def joints(value: float) -> list[RecordedMessage]:
        return [RecordedMessage("/arm", JointState.TYPE, encode(JointState(7, ("a",), [0.0], velocity=[value])), 0, 0)]

    rules = Rules(tolerance=1e9)
    assert first_divergence(joints(float("nan")), joints(float("nan")), rules) is None
    assert first_divergence(joints(float("nan")), joints(0.0), rules) is not None
    assert first_divergence(joints(float("inf")), joints(0.0), rules) is not None
    assert first_divergence(joints(float("inf")), joints(float("inf")), rules) is None


def test_bytes_that_no_field_shows_do_not_count_where_values_are_compared() -> None:
    pose = PoseStamped(7, [1.0, 2.0, 3.0])
    other = bytes(typestore().serialize_cdr(to_rosbags(pose), pose.TYPE, little_endian=False))
    a, b = ([RecordedMessage(LEFT_TARGET, pose.TYPE, data, 0, 0)] for data in (encode(pose), other))
    assert first_divergence(a, b) is not None
    assert first_divergence(a, b, Rules(tolerance=0.0)) is None


def test_a_type_that_nobody_names_is_that_of_the_topic(log: list[RecordedMessage]) -> None:
    untyped = each(log, lambda record: record._replace(type=""))
    found = first_divergence(log, untyped, Rules(("sequence",)))
    assert found is not None
    assert found.field == "type"
    assert first_divergence(log, untyped, Rules(("type",), tolerance=0.0)) is None


def test_messages_that_do_not_decode_are_compared_by_their_bytes() -> None:
    def text(data: bytes) -> list[RecordedMessage]:
        return [RecordedMessage("/json", "Thing", data, 0, 0)]

    rules = Rules(("sequence",), tolerance=1.0)
    assert first_divergence(text(b"{}"), text(b"{}"), rules) is None
    found = first_divergence(text(b"{1}"), text(b"{2}"), rules)
    assert found is not None
    assert (found.field, found.kind) == ("bytes[1]", "changed")


def test_topics_are_chosen_and_left_out(log: list[RecordedMessage], tmp_path: Path) -> None:
    def moved(record: RecordedMessage) -> RecordedMessage:
        return altered(record, frame_id="other") if record.topic == RIGHT_TARGET else record

    a = write_foreign(tmp_path / "a.mcap", log)
    b = write_foreign(tmp_path / "b.mcap", each(log, moved))
    found = diff(a, b)
    assert isinstance(found, Divergence)
    assert found.topic == RIGHT_TARGET
    for config in (
        DiffConfig(ignored=(RIGHT_TARGET,)),
        DiffConfig(topics=("/sample/*", LEFT_TARGET)),
        DiffConfig(topics=("/hand/*",), ignored=("/*/right/*",)),
        DiffConfig(ignored=("header",)),
    ):
        assert diff(a, b, config) is None
    for config, line in (
        (DiffConfig(topics=("/nothing",)), "--topic: no topic /nothing in the logs; there are: /hand/left/target"),
        (DiffConfig(ignored=("/nothing*",)), r"--ignore: no topic /nothing\*"),
        (DiffConfig(topics=("/hand/*",), ignored=("/hand/*",)), "a topic that is left to compare, found none"),
    ):
        with pytest.raises(LogError, match=line):
            diff(a, b, config)


@pytest.mark.parametrize("name", ["sequnce", "pose.x", "positions", "", "joint"])
def test_a_field_that_is_none_is_refused_and_those_there_are_are_named(name: str) -> None:
    with pytest.raises(ConfigError, match=r"--ignore: expected a topic or one of sequence, type, .*, found"):
        Rules((name,))


@pytest.mark.parametrize("name", [*known_fields(), "header", "pose", "position[0]", "effort*", "*", "transforms"])
def test_every_field_can_be_left_out(name: str) -> None:
    assert Rules((name,)).ignored == (name,)


@pytest.mark.parametrize("tolerance", [-1.0, float("nan"), float("inf")])
def test_a_tolerance_that_is_none_is_refused(tolerance: float) -> None:
    with pytest.raises(ConfigError, match="--tolerance: expected a number from 0 up"):
        Rules(tolerance=tolerance)


def test_rules_are_for_logs(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        (tmp_path / name).write_bytes(b"PK\x03\x04")
    with pytest.raises(ConfigError, match="expected two logs beside them"):
        diff(tmp_path / "a.npz", tmp_path / "b.npz", DiffConfig(tolerance=0.1))
