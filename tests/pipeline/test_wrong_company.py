"""A learner in bad company learns from its own stream alone, whatever others do, and says what it refused."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import Popen

import pytest
from episodes import write_episode
from intruder import HUGE, await_word, intruder
from processes import reenact, start, wait_for_line

from pipeline.learner_config import LearnerConfig
from pipeline.training import train
from recorders.cdr import decode, encode
from recorders.errors import WireError
from recorders.messages import JointState, PoseStamped
from recorders.records import Stamped
from recorders.topics import LEARNER_TOPICS, LEFT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.wire.frames import batch_topic
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import MAX_PAYLOAD
from recorders.wire.session import SessionConfig, open_session
from replay.engine import Replay
from replay.schedule import Schedule
from replay.zenoh_transport import ZenohTransport

SEED = 5


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("company") / "log.mcap", samples=40)


@contextmanager
def learner(folder: Path, *options: object) -> Iterator[tuple[str, Popen[str]]]:
    """Start a learner that waits for a stream; yields its endpoint and its process."""
    endpoint = free_endpoint()
    arguments = ("learn", "--listen", endpoint, "--out", "c.npz", "--seed", SEED, "--json", *options)
    with start(*arguments, cwd=folder) as process:
        try:
            wait_for_line(process, "waits for a replay")
            yield endpoint, process
        finally:
            process.kill()


def test_an_intruder_changes_nothing_and_is_named(log: Path, tmp_path: Path) -> None:
    epochs = 4
    expected = train([log], schedule=Schedule(epochs=epochs), config=LearnerConfig(seed=SEED)).result()
    with learner(tmp_path) as (endpoint, process), intruder(endpoint) as guest:
        await_word(guest, "garbage is out")
        slow = ("--epochs", epochs, "--rate", 40, "--window", 64)  # as long as the intruder needs, and half as much
        with start("replay", log, "--connect", endpoint, *slow, "--json", cwd=tmp_path) as replay:
            await_word(guest, "done")
            assert replay.poll() is None
            replayed, complaints = replay.communicate(timeout=120)
        learned, said = process.communicate(timeout=60)
    assert (replay.returncode, process.returncode) == (0, 0), complaints + said
    assert json.loads(replayed)["consumers"]["learner"] == expected
    assert json.loads(learned) == expected | {"controller": "c.npz"}
    for topic in (SESSION_PHASE, batch_topic(), *(topic.name for topic in LEARNER_TOPICS)):
        assert f"refused a message on {topic}: not of the stream that is under way\n" in said
    assert f"refused a message on {SAMPLE_JOINTS}: {HUGE} bytes, expected at most {MAX_PAYLOAD}\n" in said
    assert "that are no frame of a replay" in said
    assert "\x1b" not in said
    assert "Traceback" not in said + complaints


def backwards(message: Stamped) -> Stamped:
    """The same message, a second earlier than the log begins."""
    target = decode(message.type, message.data)
    assert isinstance(target, PoseStamped)
    return message._replace(data=encode(replace(target, stamp_ns=0)))


def of_another_robot(message: Stamped) -> Stamped:
    joints = decode(message.type, message.data)
    assert isinstance(joints, JointState)
    return message._replace(data=encode(replace(joints, name=("antenna", *joints.name[1:]))))


@pytest.mark.parametrize(
    ("topic", "spoil", "complaint"),
    [
        (LEFT_TARGET, backwards, f"{LEFT_TARGET} #20: stamp 0 ns runs backwards, the one before was 3800000000 ns"),
        (SAMPLE_JOINTS, of_another_robot, "no joint hip_height in the message"),
    ],
    ids=["time that runs backwards", "another robot"],
)
def test_a_bad_message_of_its_own_stream_is_named_and_the_learner_goes_on_from_before_it(
    log: Path, tmp_path: Path, topic: str, spoil: object, complaint: str
) -> None:
    source = Replay([log], Schedule(epochs=1))
    expected = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=SEED)).result()
    bad = [index for index, message in enumerate(source.stream()) if message.topic == topic][2 * 41 + 20]

    def spoilt(begin: int) -> Iterator[Stamped]:
        for index, message in enumerate(source.stream(begin), begin):
            yield spoil(message) if index == bad else message  # type: ignore[operator]

    keeping = ("--checkpoint", "k.npz", "--every", 10_000)
    with learner(tmp_path, *keeping) as (endpoint, process):
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            with pytest.raises(WireError, match=complaint):
                ZenohTransport(session).deliver(source.offer(), spoilt)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert f"reenact: log.mcap: {complaint}" in said.splitlines()[-1]

    with learner(tmp_path, *keeping) as (endpoint, process):
        replayed = reenact("replay", log, "--epochs", 1, "--connect", endpoint, "--json", cwd=tmp_path)
        _, said = process.communicate(timeout=60)
    tick = bad - (bad - 1 - 2 * 124) % 3
    assert f"from message {tick} on" in said
    assert json.loads(replayed.stdout)["consumers"]["learner"] == expected
