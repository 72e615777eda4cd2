"""`learn --live`: one learner from whoever publishes, from the log it kept, and from a recorder's beside it."""

import json
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pytest
import zenoh
from episodes import PERIOD_NS, write_episode
from held_stream import HeldStream
from live import robot as robot_node
from live import spawn
from processes import complaint, reenact, start, wait_for_line
from unfinished import so_far
from waiting import wait_for_arrival, wait_until

from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner_node.live_learner import LiveConfig, LiveLearner
from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import load_robot
from pipeline.robot.range_check import range_check
from pipeline.training.trainer import Trainer, train_on
from recorders.cdr.codec import decode, decode_as, encode
from recorders.messages.message_types import Float64MultiArray, JointState, Message, String
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    LEARNER_DIGEST,
    LEARNER_ERROR,
    LEARNER_OUTPUT,
    LEARNER_STATUS,
    LEFT_TARGET,
    SESSION_PHASE,
)
from recorders.protocol.frames import MAX_PAYLOAD, NO_RUN, Frame, FrameType, pack, unpack
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import message_key
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.sources.live import LiveStream, live_offer
from replay.sources.playback import Playback, PlaybackConfig
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.sources.session import RecordedSession
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

SEED = 5
TICKS = 100
SAME = ("digest", "stream_digest", "steps", "ticks", "train_cm")
ASIMO = load_robot("asimo")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("live") / "log.mcap", samples=TICKS - 1)


@pytest.fixture(scope="module")
def ticks(log: Path) -> list[list[RecordedMessage]]:
    records = list(LogReader(log))
    return [records[3 * tick : 3 * tick + 3] for tick in range(TICKS)]


@contextmanager
def learner(folder: Path, *options: object, router: str = "") -> Iterator[tuple[str, Popen[str]]]:
    """Start a learner that learns live, and listens if there is no router; yields its endpoint and its process."""
    endpoint = router or free_endpoint()
    there = ("--connect" if router else "--listen", endpoint)
    arguments = ("learn", "--live", *there, "--out", "c.npz", "--seed", SEED, "--json", *options)
    with start(*arguments, "--robot", "asimo", cwd=folder) as process:
        wait_for_line(process, "learns asimo from reenact/**")
        yield endpoint, process
        process.kill()


def ended(process: Popen[str]) -> tuple[dict[str, Any], list[str]]:
    """Return the result of a learner that ends by itself, and what it said."""
    printed, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert "Traceback" not in said
    return json.loads(printed), said.splitlines()


class Publisher:
    """Publishes as a robot does, with our attachment or without, and hears what the learner says."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self.heard: list[RecordedMessage] = []
        session.declare_subscriber("reenact/learner/*", self._note)  # one, so that they come in the order of the puts

    def say(self, records: Sequence[RecordedMessage], *, numbered: bool = True) -> None:
        for record in records:
            attachment = pack(Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (record,)))[1] if numbered else None
            key = message_key("reenact", record.topic)
            block = zenoh.CongestionControl.BLOCK
            self._session.put(key, record.data, attachment=attachment, congestion_control=block)

    def put(self, key: str, data: bytes) -> None:
        self._session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)

    def await_ticks(self, count: int) -> None:
        """Wait until the learner says that it has taken so many."""
        wait_until(lambda: any(status["ticks"] == count for status in self.texts(LEARNER_STATUS)))

    def texts(self, topic: str) -> list[dict[str, Any]]:
        return [json.loads(decode_as(String, r.data).data) for r in self.heard if r.topic == topic]

    def numbers(self, topic: str) -> list[tuple[int, np.ndarray]]:
        found = [record for record in self.heard if record.topic == topic]
        return [(record.log_time_ns, decode_as(Float64MultiArray, record.data).data) for record in found]

    def _note(self, sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        topic = "/" + str(sample.key_expr).removeprefix("reenact/")
        self.heard += unpack(topic, sample.payload.to_bytes(), sample.attachment.to_bytes()).messages


@contextmanager
def publisher(endpoint: str) -> Iterator[Publisher]:
    with open_session(SessionConfig(connect=(endpoint,))) as session:
        yield Publisher(session)


def flat(ticks: Sequence[Sequence[RecordedMessage]]) -> list[RecordedMessage]:
    return [record for tick in ticks for record in tick]


def offline(records: Sequence[RecordedMessage], *, epochs: int = 1) -> dict[str, Any]:
    """Learn in this process from the same messages."""
    live = LiveStream(epochs=epochs, check=range_check(ASIMO))
    stream = [out for record in records for out in live.feed(record)]
    trainer = Trainer(LearnerConfig(seed=SEED), robot=ASIMO)
    trainer.hello(live_offer(live.run, epochs=epochs, robot={}))
    return trainer.consume(iter(stream))


def as_recorded(log: Path) -> dict[str, Any]:
    """Train in this process as `train --as-recorded` does."""
    return train_on(RecordedSession(log), Trainer(LearnerConfig(seed=SEED))).result()


def picked(result: dict[str, Any]) -> dict[str, Any]:
    return {name: result[name] for name in SAME}


def marker(*, epoch: int, cycle: int, phase: str) -> RecordedMessage:
    data = encode(Phase("ab" * 16, epoch, cycle, phase, log="").to_message())
    return RecordedMessage(SESSION_PHASE, String.TYPE, data, 7 * epoch + cycle, 0)


def altered(record: RecordedMessage, **changes: object) -> RecordedMessage:
    message: Message = decode(record.type, record.data)
    return record._replace(data=encode(replace(message, **changes)))


def test_a_paced_replay_live_and_both_recordings_of_it_are_one_state(log: Path, tmp_path: Path) -> None:
    recording = ("record", "--out", "beside.mcap", "--include", "/hand/*", "--include", "/sample/*", "--json")
    endpoint, learning = free_endpoint(), ("--ticks", TICKS, "--record", "kept.mcap")
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        learner(tmp_path, *learning, router=endpoint) as (_, process),
    ):
        with start(*recording, "--connect", endpoint, cwd=tmp_path) as recorder:
            wait_for_line(recorder, "records reenact/**")
            for name in ("learner", "recorder"):
                wait_for_arrival(session, name)
            played = reenact("replay", log, "--play", "--rate", 40, "--connect", endpoint, cwd=tmp_path)
            assert played.returncode == 0, played.stderr
            assert "nobody listens" not in played.stderr
            live, said = ended(process)
            wait_for_arrival(session, "recorder")
            recorder.send_signal(signal.SIGINT)
            assert json.loads(recorder.communicate(timeout=120)[0])["gaps"] == {}
    assert said == []
    assert (live["refused"], live["dropped"], live["gaps"], live["ticks"]) == ({}, 0, 0, TICKS)
    assert live["steps"] == TICKS - 1

    training = ("train", "beside.mcap", "--as-live", "--robot", "asimo", "--seed", SEED, "--out", "t.npz", "--json")
    trained = reenact(*training, cwd=tmp_path)
    assert trained.returncode == 0, trained.stderr
    assert picked(json.loads(trained.stdout)) == picked(live)
    assert as_recorded(tmp_path / "kept.mcap") == picked(live)
    assert Controller.load(tmp_path / "c.npz").digest == live["digest"]


def test_from_bare_messages_it_learns_says_what_it_does_and_ends_by_a_signal(
    ticks: list[list[RecordedMessage]], tmp_path: Path
) -> None:
    with learner(tmp_path) as (endpoint, process), publisher(endpoint) as robot:
        robot.say(flat(ticks), numbered=False)
        robot.await_ticks(TICKS)
        process.send_signal(signal.SIGTERM)
        result, said = ended(process)
        outputs, errors = robot.numbers(LEARNER_OUTPUT), robot.numbers(LEARNER_ERROR)
        digests, statuses = robot.texts(LEARNER_DIGEST), robot.texts(LEARNER_STATUS)
    assert said == []
    assert picked(result) == offline(flat(ticks))
    assert [stamp_ns for stamp_ns, _ in outputs] == [PERIOD_NS * tick for tick in range(TICKS - 1)]
    assert {len(values) for _, values in outputs} == {6 + len(ASIMO.joints)}
    assert all(len(values) == 2 and 0.0 < values.max() < 2.0 for _, values in errors)
    assert digests[-1]["state"] == result["digest"]
    assert digests[-1]["stream"] == result["stream_digest"]
    assert statuses[-1] | {"ticks": TICKS, "refused": {}, "dropped": 0, "gaps": 0} == statuses[-1]


def test_what_had_arrived_when_it_is_stopped_is_learned(ticks: list[list[RecordedMessage]]) -> None:
    endpoint, arrived = free_endpoint(), threading.Event()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        LearnerPublisher(session, keys=NamespaceKeys()) as voice,
    ):
        with Receiver(session, config=ReceiverConfig(live=True)) as receiver, publisher(endpoint) as robot:
            session.declare_subscriber("after", lambda sample: arrived.set())
            robot.say(flat(ticks))
            robot.put("after", b"")
            assert arrived.wait(120)
            trainer = Trainer(LearnerConfig(seed=SEED), robot=ASIMO)
            live = LiveLearner(trainer, ASIMO, LiveConfig(), receiver, voice)
            result = live.run(lambda: True, keep=lambda record: None)
    assert picked(result) == offline(flat(ticks))


def test_bad_company_changes_nothing_and_is_named(ticks: list[list[RecordedMessage]], tmp_path: Path) -> None:
    left, _, joints = ticks[40]
    other = JointState(0, ("antenna",), [0.0])
    bad = [
        left._replace(data=b"\x00\x01"),
        left._replace(data=encode(other)),
        altered(left, position=[1e300, 0.0, 0.0]),
        altered(left, stamp_ns=0),
        joints._replace(data=encode(other)),
        joints._replace(data=bytes(100_000)),
        joints._replace(data=bytes(MAX_PAYLOAD + 1)),
        RecordedMessage(SESSION_PHASE, String.TYPE, b"\xff" * 50, 0, 0),
        left._replace(topic="/nothing/of\x1bours"),
    ]
    with learner(tmp_path, "--ticks", TICKS) as (endpoint, process), publisher(endpoint) as robot:
        robot.say(flat(ticks[:40]))
        for numbered in (True, False):
            robot.say(bad * 3, numbered=numbered)
        robot.say(flat(ticks[40:]))
        result, said = ended(process)
    assert picked(result) == offline(flat(ticks))
    assert result["refused"] == {
        "/hand/left/target: implausible": 6,
        "/hand/left/target: not after the last tick": 6,
        "/hand/left/target: unreadable": 12,
        "/sample/joint_states: too large": 6,
        "/sample/joint_states: unread": 6,
        "/sample/joint_states: wrong joints": 6,
        "/session/phase: marker": 6,
    }
    assert (result["dropped"], result["gaps"]) == (0, 0)
    assert any("refused, wrong joints: /sample/joint_states #40: no joint hip_height" in line for line in said)
    assert any("stamp 0 ns is not after the tick at" in line for line in said)
    assert len(said) == 7 + 1  # each reason the first time, one the tenth
    assert "\x1b" not in "".join(said)


def test_markers_are_followed_and_no_pair_is_learned_across_a_missing_tick(
    ticks: list[list[RecordedMessage]], tmp_path: Path
) -> None:
    lossy = flat(ticks[:10]) + ticks[10][1:] + flat(ticks[11:15]) + flat(ticks[18:20])
    heard = [
        record
        for epoch in range(2)
        for cycle, phase in enumerate((WASHOUT, LEARN, EVALUATE))
        for record in [marker(epoch=epoch, cycle=cycle, phase=phase), *lossy]
    ]
    cycles, complete = 6, 16
    options = ("--epochs", 2, "--ticks", cycles * complete, "--record", "kept.mcap")
    with learner(tmp_path, *options) as (endpoint, process), publisher(endpoint) as robot:
        robot.say(heard)
        result, said = ended(process)
    assert picked(result) == offline(heard, epochs=2) == as_recorded(tmp_path / "kept.mcap")
    assert (result["gaps"], result["dropped"]) == (2 * cycles, cycles)
    assert result["steps"] == cycles * (complete - 3)
    assert result["train_cm"] is not None
    assert result["run"] == "ab" * 16
    assert [line.partition(" ns")[0] for line in said] == [
        "ticks are missing before the one at 2200000000",
        "ticks are missing before the one at 3600000000",
    ]


def short_motion(path: Path) -> Path:
    """A second of small circles at 10 Hz."""
    angles = 2.0 * np.pi * np.arange(11) / 10
    circle = 0.02 * np.column_stack([np.zeros(11), np.cos(angles), np.sin(angles)])
    rows = np.column_stack([angles / (2.0 * np.pi), ASIMO.centres[0] + circle, ASIMO.centres[1] + circle])
    path.write_text("\n".join(["t,lx,ly,lz,rx,ry,rz", *(",".join(map(repr, row)) for row in rows.tolist())]))
    return path


def test_an_exploration_that_awaits_nobody_is_learned_from_and_the_robot_says_which_it_is(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    learning = ("learn", "--live", "--connect", endpoint, "--out", "c.npz", "--seed", SEED, "--json")
    phases = [[WASHOUT, 1], [LEARN, 1]]
    exploring = {"connect": endpoint, "motion": str(short_motion(tmp_path / "short.csv")), "seed": 3}
    exploring |= {"phases": phases, "settle_ns": 500_000_000, "consumers": []}
    with robot_node(endpoint), start(*learning, "--ticks", 24, "--record", "kept.mcap", cwd=tmp_path) as process:
        wait_for_line(process, "learns asimo from reenact/**")
        with spawn("explore", **exploring) as explorer:
            explored, complaints = explorer.communicate(timeout=120)
        assert explorer.returncode == 0, complaints
        result, said = ended(process)
    assert said == []
    assert result["run"] == json.loads(explored)["run"]
    assert (result["steps"], result["gaps"], result["dropped"]) == (22, 0, 0)
    assert picked(result) == as_recorded(tmp_path / "kept.mcap")


def test_killed_it_goes_on_from_its_checkpoint(ticks: list[list[RecordedMessage]], tmp_path: Path) -> None:
    keeping = ("--checkpoint", "k.npz", "--checkpoint-every", 10)
    with learner(tmp_path, *keeping) as (endpoint, process), publisher(endpoint) as robot:
        robot.say(flat(ticks[:50]))
        robot.await_ticks(50)
        process.kill()
        process.communicate(timeout=120)
    before = Controller.load(tmp_path / "k.npz").provenance["checkpoint"]["counts"]["ticks"]
    assert before >= 40
    with learner(tmp_path, *keeping, "--ticks", 50) as (endpoint, process), publisher(endpoint) as robot:
        robot.say(flat(ticks[50:]))
        result, _ = ended(process)
    assert result["ticks"] == before + 50
    assert result["steps"] == before - 1 + 50 - 1


def test_progress_is_the_share_of_the_stream_where_its_length_is_known(log: Path) -> None:
    shown: list[tuple[int, float | None]] = []

    def trainer() -> Trainer:
        shown.clear()
        return Trainer(LearnerConfig(), on_progress=lambda ticks, share: shown.append((ticks, share)))

    def is_the_share() -> bool:
        return all(share == pytest.approx(ticks / (7 * TICKS), abs=0.01) for ticks, share in shown)

    source = Replay([log], Schedule(epochs=1))
    train_on(source, trainer())  # presentation by presentation, as the log is in memory
    assert (len(shown), is_the_share()) == (7, True)
    heard = trainer()
    heard.hello(source.offer())
    heard.consume(source.stream())
    assert (len(shown), is_the_share()) == (7 * TICKS // 64, True)
    heard = trainer()
    heard.hello(replace(source.offer(), messages=None))
    heard.consume(source.stream())
    assert {share for _, share in shown} == {None}


def test_where_nothing_can_be_learned_no_controller_is_written(
    ticks: list[list[RecordedMessage]], tmp_path: Path
) -> None:
    far = [altered(record, position=[320.0, 200.0, 760.0]) for tick in ticks for record in tick[:2]]
    with learner(tmp_path, "--checkpoint", "k.npz") as (endpoint, process), publisher(endpoint) as robot:
        robot.say(far)
        wait_for_line(process, "(100 times so far)")
        process.send_signal(signal.SIGINT)
        printed, said = process.communicate(timeout=120)
    assert (process.returncode, printed) == (2, "")
    assert "nothing was learned: " in said.splitlines()[-1]
    assert "found 0 ticks, no two that make a step; refused " in said.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_stream_that_breaks_off_leaves_it_alive_and_one_that_ends_ends_it(
    log: Path, ticks: list[list[RecordedMessage]], tmp_path: Path
) -> None:
    with learner(tmp_path, "--record", "kept.mcap") as (endpoint, process), publisher(endpoint) as robot:
        awaited = ("replay", log, "--play", "--await", "learner", "--wait", 120, "--json", "--connect", endpoint)
        with start(*awaited, "--rate", 1, "--window", 1, "--start", 15, "--loop", 0, cwd=tmp_path) as first:
            wait_for_line(process, "takes run")
            first.send_signal(signal.SIGTERM)
            first.communicate(timeout=120)
        wait_for_line(process, "a stream broke off, the learner goes on")
        robot.say([marker(epoch=0, cycle=1, phase=LEARN)])
        wait_until(lambda: marked(tmp_path / "kept.mcap.part", cycle=1))
        playback = Playback([log], PlaybackConfig())
        held = HeldStream(playback, at=50)
        with open_session(SessionConfig(connect=(endpoint,))) as session, ThreadPoolExecutor() as pool:
            transport = ZenohTransport(session, config=SenderConfig(batch_size=1, window=30, wait_s=120.0))
            delivered = pool.submit(transport.deliver, playback.offer(), held.stream)
            wait_for_line(process, "takes run")
            robot.say([altered(ticks[99][0], position=[0.3, 0.2, 0.7])])
            wait_for_line(process, "a message that is not of the stream that awaits this learner")
            held.may_go_on.set()
            result, _ = ended(process)
            replayed = delivered.result(timeout=120)
    assert result["ticks"] >= TICKS
    assert result["refused"] == {f"{LEFT_TARGET}: not of the stream": 1}
    assert picked(result) == as_recorded(tmp_path / "kept.mcap")
    assert replayed["learner"]["digest"] == result["digest"]


def marked(part: Path, *, cycle: int) -> bool:
    """Whether a log that is being written holds the marker of a cycle."""
    markers = [record for record in so_far(part) if record.topic == SESSION_PHASE]
    return any(Phase.from_message(decode_as(String, record.data)).cycle == cycle for record in markers)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--ticks", 5), "expected --live beside them"),
        (("--live", "--robot", "asimo", "--record", "nowhere/log.mcap"), "nowhere"),
    ],
)
def test_bad_usage_is_one_clear_line(tmp_path: Path, options: tuple[object, ...], expected: str) -> None:
    run = reenact("learn", "--out", "c.npz", "--listen", free_endpoint(), *options, cwd=tmp_path)
    assert expected in complaint(run)
