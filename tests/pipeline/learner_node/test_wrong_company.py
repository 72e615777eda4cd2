"""A learner in bad company learns from its own stream alone, whatever others do, and says what it refused."""

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import Popen
from typing import Any, TypeAlias

import pytest
from episodes import write_episode
from intruder import HUGE, await_word, intruder, keys_of
from processes import start, wait_for_line

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.cdr.codec import decode, encode
from recorders.errors import WireError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS, LEFT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.protocol.frames import MAX_PAYLOAD, batch_topic
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import StreamFrom
from replay.transports.zenoh import ZenohTransport

SEED = 5
Spoil: TypeAlias = Callable[[RecordedMessage], RecordedMessage]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("company") / "log.mcap", samples=40)


@contextmanager
def learner(folder: Path, *options: object) -> Iterator[tuple[str, Popen[str]]]:
    """Start a learner that waits for a stream; yields its endpoint and its process."""
    endpoint = free_endpoint()
    arguments = ("learn", "--listen", endpoint, "--out", "c.npz", "--seed", SEED, "--json", *options)
    with start(*arguments, cwd=folder) as process:
        wait_for_line(process, "waits for a replay")
        yield endpoint, process
        process.kill()


def deliver(endpoint: str, source: Replay, stream_from: StreamFrom, **options: Any) -> dict[str, Any]:
    with open_session(SessionConfig(connect=(endpoint,))) as session:
        config = SenderConfig(wait_s=120.0, **options)
        return ZenohTransport(session, config=config).deliver(source.offer(), stream_from)["learner"]


@pytest.mark.parametrize("domain", [None, 4])
def test_an_intruder_changes_nothing_and_is_named(log: Path, tmp_path: Path, domain: int | None) -> None:
    in_ros, keys = () if domain is None else ("--ros", domain), keys_of(domain)
    source = Replay([log], Schedule(epochs=1))
    expected = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=SEED)).result()
    with (
        learner(tmp_path, *in_ros) as (endpoint, process),
        intruder(endpoint, domain=domain) as guest,
        ThreadPoolExecutor() as threads,
    ):
        await_word(guest, "garbage is out")
        done = threads.submit(await_word, guest, "done")

        def slow(begin: int) -> Iterator[RecordedMessage]:
            """The stream, all through what the intruder does."""
            for index, message in enumerate(source.stream(begin), begin):
                if index == len(source) - 1:
                    done.result(timeout=120)
                elif not done.done():
                    time.sleep(0.002)
                yield message

        replayed = deliver(endpoint, source, slow, window=64, batch_size=1, keys=keys)
        learned, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert replayed == expected
    assert json.loads(learned) == expected | {"controller": "c.npz", "pairs": "commanded"}
    for topic in (SESSION_PHASE, batch_topic(), *(topic.name for topic in LEARNER_TOPICS)):
        assert f"refused a message on {topic}: not of the stream that is under way\n" in said
    for topic in (LEFT_TARGET, batch_topic()):
        assert f"refused a message on {topic}: a frame of the stream that is under way, but not sealed" in said
    for verb in ("hello", "status"):
        assert f"refused a message on @consumer/learner/{verb}: " in said
    assert f"refused a message on {SAMPLE_JOINTS}: {HUGE} bytes, expected at most {MAX_PAYLOAD}\n" in said
    assert "that are no frame of a replay" in said
    assert "\x1b" not in said
    assert "Traceback" not in said


def backwards(message: RecordedMessage) -> RecordedMessage:
    """The same message, a second earlier than the log begins."""
    target = decode(message.type, message.data)
    assert isinstance(target, PoseStamped)
    return message._replace(data=encode(replace(target, stamp_ns=0)))


def of_another_robot(message: RecordedMessage) -> RecordedMessage:
    joints = decode(message.type, message.data)
    assert isinstance(joints, JointState)
    return message._replace(data=encode(replace(joints, name=("antenna", *joints.name[1:]))))


SPOILT: tuple[tuple[str, Spoil, str], ...] = (
    (LEFT_TARGET, backwards, f"{LEFT_TARGET} #20: stamp 0 ns runs backwards, the one before was 3800000000 ns"),
    (SAMPLE_JOINTS, of_another_robot, f"{SAMPLE_JOINTS} #20: no joint hip_height in the message"),
)
KEEPING = ("--checkpoint", "k.npz", "--checkpoint-every", 10_000)


def test_a_bad_message_of_its_own_stream_is_named_and_the_learner_goes_on_from_before_it(
    log: Path, tmp_path: Path
) -> None:
    source = Replay([log], Schedule(epochs=1))
    expected = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=SEED)).result()
    begins = 0
    for cycle, (topic, spoil, complaint) in enumerate(SPOILT, 2):
        bad = [index for index, message in enumerate(source.stream()) if message.topic == topic][cycle * 41 + 20]

        def spoilt(begin: int, *, bad: int = bad, spoil: Spoil = spoil) -> Iterator[RecordedMessage]:
            for index, message in enumerate(source.stream(begin), begin):
                yield spoil(message) if index == bad else message

        with learner(tmp_path, *KEEPING) as (endpoint, process):
            with pytest.raises(WireError, match=complaint):
                deliver(endpoint, source, spoilt)
            _, said = process.communicate(timeout=120)
        assert process.returncode == 2
        assert f"from message {begins} on" in said
        assert f"reenact: log.mcap: {complaint}" in said.splitlines()[-1]
        begins = bad - (bad - 1 - cycle * 124) % 3  # its tick

    with learner(tmp_path, *KEEPING) as (endpoint, process):
        assert deliver(endpoint, source, source.stream) == expected
        _, said = process.communicate(timeout=120)
    assert f"from message {begins} on" in said
