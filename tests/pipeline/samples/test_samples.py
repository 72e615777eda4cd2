"""What a step is given and taught: d(k) = (u(k+1); q(k)), q(k) read at the end of the hold of u(k)."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode

from pipeline.robot.config import load_robot
from pipeline.samples.pairs import read_samples
from pipeline.samples.rules.commanded import CommandedPairs
from recorders.cdr.codec import decode_as
from recorders.errors import JointError, LogError, MessageError
from recorders.messages.message_types import JointState, Message, PoseStamped
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import join_ticks
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay


def on_joints(
    edit: Callable[[int, JointState], JointState],
) -> Callable[[int, str, Message], Sequence[tuple[str, Message]]]:
    def change(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        return [(topic, edit(tick, message) if isinstance(message, JointState) else message)]

    return change


def shuffled(tick: int, joints: JointState) -> JointState:
    """The same joints in another order, another one at every tick."""
    order = np.random.default_rng(tick).permutation(len(joints.name))
    return replace(joints, name=tuple(joints.name[place] for place in order), position=joints.position[order])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("samples") / "log.mcap", samples=8)


def test_each_tick_teaches_the_step_before_it(log: Path) -> None:
    robot = load_robot("asimo")
    ticks = list(join_ticks(LogReader(log)))
    pairs, u, d = CommandedPairs(robot), np.empty(6), np.empty(21)
    assert pairs.pending.shape == (0,)
    assert not pairs.fill(ticks[0], u, d)
    for held, tick in pairwise(ticks):
        assert np.array_equal(pairs.pending, np.concatenate(held.hands))
        assert pairs.fill(tick, u, d)
        assert np.array_equal(u, np.concatenate(held.hands))
        assert np.array_equal(d, np.concatenate([*tick.hands, tick.joints.position]))
    pairs.begin()
    assert not pairs.fill(ticks[0], u, d)


def test_a_log_of_t_plus_one_ticks_has_t_samples(log: Path) -> None:
    samples = read_samples(log)
    assert samples.targets.shape == (8, 6)
    assert samples.joints.shape == (8, 15)


def test_samples_are_what_was_logged_at_the_end_of_each_hold(log: Path) -> None:
    robot, samples = load_robot("asimo"), read_samples(log)
    logged = [decode_as(JointState, record.data) for record in LogReader(log) if record.topic == SAMPLE_JOINTS]
    for place, name in enumerate(robot.joints):
        expected = [joints.position[joints.name.index(name)] for joints in logged[1:]]
        assert samples.joints[:, place].tolist() == expected, name
    for columns, topic in ((slice(0, 3), LEFT_TARGET), (slice(3, 6), RIGHT_TARGET)):
        poses = [decode_as(PoseStamped, record.data) for record in LogReader(log) if record.topic == topic]
        assert np.array_equal(samples.targets[:, columns], [pose.position for pose in poses[:-1]])


def test_joints_are_mapped_by_name(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "shuffled.mcap", samples=8, change=on_joints(shuffled))
    assert np.array_equal(read_samples(other).joints, read_samples(log).joints)
    assert np.array_equal(read_samples(other).targets, read_samples(log).targets)


def test_a_renamed_joint_is_named(tmp_path: Path) -> None:
    def rename(tick: int, joints: JointState) -> JointState:
        return replace(joints, name=("antenna", *joints.name[1:]))

    path = write_episode(tmp_path / "log.mcap", samples=2, change=on_joints(rename))
    with pytest.raises(JointError, match=rf"no joint {load_robot('asimo').joints[0]} .* antenna"):
        read_samples(path)


def test_nan_is_refused_and_named(tmp_path: Path) -> None:
    def spoil(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        if tick == 1 and isinstance(message, PoseStamped):
            message = replace(message, position=np.array([np.nan, 0.0, 0.0]))
        return [(topic, message)]

    path = write_episode(tmp_path / "log.mcap", samples=2, change=spoil)
    with pytest.raises(MessageError, match=r"/hand/left/target #1: expected finite numbers at 200000000 ns, found nan"):
        read_samples(path)


def test_one_tick_is_no_sample(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="at least two complete ticks"):
        read_samples(write_episode(tmp_path / "log.mcap", samples=0))


def test_of_a_session_the_first_presentation_counts(log: Path, tmp_path: Path) -> None:
    replay = Replay([log], Schedule(epochs=1))
    with LogWriter(tmp_path / "session.mcap", manifest={}) as writer:
        writer.copy(next(iter(LogReader(log))))  # of before the session
        for message in replay.stream():
            writer.copy(message)
    session = read_samples(tmp_path / "session.mcap", robot=load_robot("asimo"))
    assert np.array_equal(session.targets, read_samples(log).targets)
    assert np.array_equal(session.joints, read_samples(log).joints)


def test_a_log_without_a_robot_is_read_with_one_that_is_given(log: Path, tmp_path: Path) -> None:
    bare = write_episode(tmp_path / "bare.mcap", samples=8, attachments={})
    with pytest.raises(LogError, match="expected the robot's files"):
        read_samples(bare)
    assert np.array_equal(read_samples(bare, robot=load_robot("asimo")).joints, read_samples(log).joints)
