"""Ticks come live with the very message that completes them, and nothing is looked at before one may be complete."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab import MS, START, anew, recording
from tracked_arm import shifted

from pipeline.alignment import live as module
from pipeline.alignment.aligned_log import own_frames
from pipeline.alignment.blocks import joints_kind, pose_kind
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.live import AlignedStream, LiveAligner, LiveInputs
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.ticks import Aligner, Source
from pipeline.robot.config import load_robot
from recorders.cdr.codec import encode
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState, PoseStamped, String, TFMessage
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE, TF_STATIC

HAND, TARGET = "/hand/tip/measured", "/hand/tip/target"
TICK, RENAMES = (HAND, SAMPLE_JOINTS), {"/tracker": HAND}


def aligner_of(robot: Path, config: AlignmentConfig | None = None, **options: Any) -> LiveAligner:
    return LiveAligner(load_robot(robot), config or AlignmentConfig(), **{"renames": RENAMES, "tick": TICK, **options})


def one_by_one(robot: Path, config: AlignmentConfig, records: list[RecordedMessage]) -> list[list[RecordedMessage]]:
    """Return the messages of the ticks that an aligner makes at each message that it is given alone."""
    known = load_robot(robot)
    sources = (Source("/tracker", HAND, pose_kind()), Source("/joint_states", SAMPLE_JOINTS, joints_kind(known.joints)))
    pivot = 0 if config.period_ns is None and config.ticks_of != SAMPLE_JOINTS else 1
    frames = StaticFrames(own_frames(known))
    aligner = Aligner(sources, config, period_ns=config.period_ns, pivot=pivot, frames=frames)
    rows = RowFormat(sources, known.joints)
    return [[m for ticks in aligner.feed([record]) for m in rows.records(rows.rows(ticks))] for record in records]


def disturbed(records: list[RecordedMessage], seed: int) -> list[RecordedMessage]:
    """Return messages of which some are lost, late, repeated or cut, or come in bursts of their topic."""
    generator, found = np.random.default_rng(seed), list(records)
    for place in generator.integers(0, len(found) - 60, 8):
        away = int(generator.integers(2, 50))
        found.insert(place + away, found[place])
        found.insert(place, found.pop(place + away // 2))
        found[place + 1] = found[place + 1]._replace(data=found[place + 1].data[: int(generator.integers(0, 30))])
        burst = sorted(found[place : place + away], key=lambda record: record.topic)
        found[place : place + away] = burst[: -(away // 8)] if away >= 8 else burst
    return found


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "config",
    [
        AlignmentConfig(),
        AlignmentConfig(period_ns=20 * MS),
        AlignmentConfig(period_ns=33_333_333, clock="log", tolerance_ns=25 * MS),
        AlignmentConfig(ticks_of=SAMPLE_JOINTS, latencies_ns={"/tracker": 40 * MS, "/joint_states": -25 * MS}),
        AlignmentConfig(clock="log", latencies_ns={"/tracker": -70 * MS}),
    ],
)
def test_a_tick_comes_with_the_message_that_completes_it(robot: Path, config: AlignmentConfig, seed: int) -> None:
    records = disturbed(recording(robot)[: 180 + 10 * seed], seed)
    live = aligner_of(robot, config)
    made = [live.feed(record) for record in records]
    assert made == one_by_one(robot, config, records)
    assert sum(map(len, made)) > 10


@pytest.mark.parametrize("period_ns", [None, 20 * MS])
def test_a_tick_comes_in_time_after_the_clock_began_anew_too(robot: Path, period_ns: int | None) -> None:
    config, records = AlignmentConfig(period_ns=period_ns), anew(recording(robot)[:200])
    live = aligner_of(robot, config)
    assert [live.feed(record) for record in records] == one_by_one(robot, config, records)


def test_a_tick_comes_in_time_after_a_repetition_before_the_first(robot: Path) -> None:
    """What is looked at before there can be a tick holds up none."""
    names = load_robot(robot).joints
    joints, (pose, *_) = [], (record for record in recording(robot) if record.topic == "/tracker")
    for stamp in (START, START, START + 30 * MS):
        state = JointState(stamp, names, np.full(len(names), stamp * 1e-9 - START * 1e-9))
        joints.append(RecordedMessage("/joint_states", state.TYPE, encode(state), 0, stamp))
    hand = PoseStamped(START + 10 * MS, np.array([0.5, 0.0, 0.75]))
    records = [*joints, pose._replace(data=encode(hand))]
    config = AlignmentConfig(period_ns=10 * MS)
    live = aligner_of(robot, config)
    made = [live.feed(record) for record in records]
    assert made == one_by_one(robot, config, records)
    assert [len(messages) for messages in made] == [0, 0, 0, 2]


def test_a_tick_comes_in_time_where_one_topic_alone_is_late(robot: Path) -> None:
    names, late_ns = load_robot(robot).joints, 7 * MS
    records = []
    for step in range(4):
        at = START + step * 10 * MS
        joints = JointState(at + late_ns, names, np.full(len(names), 0.1 * step))
        hand = PoseStamped(at, np.array([0.01 * step, 0.0, 0.0]))
        records += [RecordedMessage("/joint_states", joints.TYPE, encode(joints), step, at)]
        records += [RecordedMessage("/tracker", hand.TYPE, encode(hand), step, at)]
    config = AlignmentConfig(ticks_of=SAMPLE_JOINTS, latencies_ns={"/joint_states": late_ns})
    live = aligner_of(robot, config)
    made = [live.feed(record) for record in records]
    assert made == one_by_one(robot, config, records)
    assert [len(messages) for messages in made] == [0, 2] * 4


@pytest.mark.parametrize(
    ("config", "ticks"), [({"period_ns": 100 * MS}, 20), ({}, 60), ({"ticks_of": SAMPLE_JOINTS}, 200)]
)
def test_messages_wait_until_a_tick_may_be_complete(
    robot: Path, monkeypatch: pytest.MonkeyPatch, config: Any, ticks: int
) -> None:
    """Of a tracker at 30 Hz and joints at 100 Hz: what is complete is looked for about once a tick, not each time."""
    looks: list[int] = []

    def counted(aligner: Aligner, records: Any) -> Any:
        looks.append(len(records))
        return feed(aligner, records)

    feed = Aligner.feed
    monkeypatch.setattr(Aligner, "feed", counted)
    live = aligner_of(robot, AlignmentConfig(**config))
    records = [record for record in recording(robot) if record.log_time_ns < START + 2 * 10**9]
    made = sum(len(live.feed(record)) for record in records)
    assert made == pytest.approx(2 * ticks, abs=8)
    assert len(looks) <= ticks + 8
    looks.clear()
    again = [shifted(record, -1000 * 10**9) for record in records]
    assert sum(len(live.feed(record)) for record in again)
    assert len(looks) <= min(ticks + 60, 250) < len(again)  # of which some show that the clock began anew


def test_what_waits_fills_no_memory(robot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A topic that comes alone completes nothing."""
    assert module._MOST_WAITING < 10_000
    monkeypatch.setattr(module, "_MOST_WAITING", 5)
    live = aligner_of(robot)
    for number, record in enumerate(r for r in recording(robot)[:200] if r.topic == "/joint_states"):
        live.feed(record)
        assert len(live._waiting) == (number + 1) % 5


def test_topics_of_no_concern_are_passed_over_and_transforms_are_wanted(robot: Path) -> None:
    live = aligner_of(robot)
    assert live.types == {
        "/tracker": PoseStamped.TYPE,
        "/joint_states": JointState.TYPE,
        TF_STATIC: TFMessage.TYPE,
    }
    assert live.feed(recording(robot)[0]._replace(topic="/other")) == []
    assert live._waiting == []
    transform = RecordedMessage(TF_STATIC, TFMessage.TYPE, encode(TFMessage(())), 0, START)
    assert live.feed(transform) == []
    assert live._waiting == [transform]  # which completes nothing


def test_topics_are_called_as_ours_or_as_they_are_mapped(robot: Path) -> None:
    """Joints that are not mapped are the robot's own."""
    assert set(aligner_of(robot, renames={}).types) == {HAND, "/joint_states", TF_STATIC}
    mapped = aligner_of(robot, renames={"/arm": SAMPLE_JOINTS, "/a": HAND})
    assert set(mapped.types) == {"/a", "/arm", TF_STATIC}
    assert mapped.account["topics"] == {"/a": {"as": HAND}, "/arm": {"as": SAMPLE_JOINTS}}


@pytest.mark.parametrize(
    ("config", "tick", "at"),
    [
        ({}, (HAND, SAMPLE_JOINTS), {"ticks_of": "/tracker"}),
        ({}, (HAND, TARGET, SAMPLE_JOINTS), {"ticks_of": TARGET}),
        ({}, (SAMPLE_JOINTS,), {"period_ns": 100 * MS}),
        ({"period_ns": 5 * MS}, (HAND, SAMPLE_JOINTS), {"period_ns": 5 * MS}),
        ({"ticks_of": SAMPLE_JOINTS}, (HAND, SAMPLE_JOINTS), {"ticks_of": "/joint_states"}),
        ({"ticks_of": "/tracker"}, (HAND, SAMPLE_JOINTS), {"ticks_of": "/tracker"}),
    ],
)
def test_the_account_names_where_the_ticks_are(robot: Path, config: Any, tick: Any, at: Any) -> None:
    settings = AlignmentConfig(**config)
    account = aligner_of(robot, settings, tick=tick).account
    del account["topics"]
    assert account == {**settings.to_dict(), **at}


def test_ticks_of_a_topic_that_is_none_of_these_are_refused(robot: Path) -> None:
    with pytest.raises(ConfigError, match="--ticks-of: expected one of /tracker, /joint_states, found /x"):
        aligner_of(robot, AlignmentConfig(ticks_of="/x"))


def test_what_was_made_missed_and_dropped_is_counted(robot: Path) -> None:
    live = aligner_of(robot, AlignmentConfig(period_ns=20 * MS))
    records = [r for r in recording(robot)[:400] if not 10**9 < r.log_time_ns - START < 2 * 10**9]
    stamps = [made.log_time_ns for record in [*records, *records[:7]] for made in live.feed(record)][::2]
    missed = (stamps[-1] - stamps[0]) // (20 * MS) + 1 - len(stamps)
    assert live.counts == {"aligned": len(stamps), "missed": missed, "unaligned": 7}
    assert missed > 45


def marker() -> RecordedMessage:
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    return RecordedMessage(SESSION_PHASE, message.TYPE, encode(message), 5, START)


def test_inputs_that_are_not_aligned_are_renamed_alone(robot: Path) -> None:
    known, renames = load_robot(robot), {"/tracker": HAND, "/arm": SAMPLE_JOINTS}
    inputs = LiveInputs(known, None, renames=renames, tick=(HAND, TARGET, SAMPLE_JOINTS))
    poses = dict.fromkeys(("/tracker", TARGET), PoseStamped.TYPE)
    assert inputs.types == {SESSION_PHASE: String.TYPE, "/arm": JointState.TYPE} | poses
    assert inputs.topics == inputs.types.keys()
    assert (inputs.account, inputs.counts) == ([], {})
    bare = RecordedMessage("/tracker", "", encode(PoseStamped(1, np.zeros(3))), 3, 4)
    for numbered in (True, False):
        assert list(inputs.feed(bare, numbered=numbered)) == [
            (bare._replace(topic=HAND, type=PoseStamped.TYPE), numbered)
        ]
        target = bare._replace(topic=TARGET)
        assert list(inputs.feed(target, numbered=numbered)) == [(target, numbered)]
        assert list(inputs.feed(marker(), numbered=numbered)) == [(marker(), numbered)]


def test_inputs_that_are_aligned_have_numbers_and_begin_a_cycle_with_a_marker(robot: Path) -> None:
    inputs = LiveInputs(load_robot(robot), AlignmentConfig(), renames=RENAMES, tick=TICK)
    assert inputs.types == {SESSION_PHASE: String.TYPE} | aligner_of(robot).types
    records = recording(robot)[:200]
    made = [known for record in records for known in inputs.feed(record, numbered=False)]
    assert {numbered for _, numbered in made} == {True}
    assert list(inputs.feed(marker(), numbered=False)) == [(marker(), False)]
    again = [known for record in records for known in inputs.feed(record, numbered=False)]
    assert [(r.topic, r.data) for r, _ in again] == [(r.topic, r.data) for r, _ in made]
    assert again[0][0].sequence == made[-1][0].sequence + 2  # stamps begin anew, numbers go on with one left out
    assert inputs.counts == {"aligned": len(made), "missed": 0, "unaligned": 0}
    (account,) = inputs.account
    assert account == {"name": "live", "alignment": aligner_of(robot).account}


def test_a_stream_takes_what_its_inputs_make(robot: Path) -> None:
    records = recording(robot)[:200]
    inputs = LiveInputs(load_robot(robot), AlignmentConfig(), renames=RENAMES, tick=TICK)
    stream = AlignedStream(inputs, tick=TICK)
    found = [out for record in records for out in stream.feed(record)]
    assert stream.inputs is inputs
    made = [message for messages in one_by_one(robot, AlignmentConfig(), records) for message in messages]
    assert [record for record in found if record.topic != SESSION_PHASE] == made
    assert (stream.ticks, stream.gaps, stream.refused.total()) == (len(made) // 2, 0, 0)


def test_a_stream_numbers_what_nobody_did(robot: Path) -> None:
    """Messages that are not aligned, of which none has a number."""
    names = load_robot(robot).joints
    stream = AlignedStream(LiveInputs(load_robot(robot), None, renames={}, tick=TICK), tick=TICK)
    for stamp in range(1, 6):
        for topic, message in (
            (HAND, PoseStamped(stamp, np.zeros(3))),
            (SAMPLE_JOINTS, JointState(stamp, names, np.zeros(len(names)))),
        ):
            stream.feed(RecordedMessage(topic, message.TYPE, encode(message), 7, stamp), numbered=False)
    assert (stream.ticks, stream.steps, stream.gaps) == (5, 4, 0)


def test_a_stream_takes_messages_to_be_numbered(robot: Path) -> None:
    """Unless it is told otherwise: a number that is missing is a gap."""
    names = load_robot(robot).joints
    stream = AlignedStream(LiveInputs(load_robot(robot), None, renames={}, tick=TICK), tick=TICK)
    for stamp in (1, 2, 5, 6):
        for topic, message in (
            (HAND, PoseStamped(stamp, np.zeros(3))),
            (SAMPLE_JOINTS, JointState(stamp, names, np.zeros(len(names)))),
        ):
            stream.feed(RecordedMessage(topic, message.TYPE, encode(message), stamp, stamp))
    assert (stream.ticks, stream.steps, stream.gaps) == (4, 2, 1)
