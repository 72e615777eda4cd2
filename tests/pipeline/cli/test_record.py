"""The recorder: any publisher's messages to MCAP, in order, with gaps counted, finished cleanly whatever ends it."""

import json
import random
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import zenoh
from episodes import write_episode
from here import reenact_here
from live import robot as live_robot
from live import spawn
from processes import complaint, reenact, start, wait_for_line
from short_motion import write_short_motion
from stepped_clock import SteppedClock
from unfinished import so_far
from waiting import wait_for_subscriber, wait_until

from pipeline.learner.controller import Controller
from pipeline.robot.config import load_robot
from recorders.cdr.codec import decode_as, encode
from recorders.containers.opening import open_log
from recorders.errors import LogError, WireError
from recorders.messages.message_types import Float64MultiArray, PoseStamped, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    LEARNER_DIGEST,
    LEARNER_ERROR,
    LEARNER_OUTPUT,
    LEARNER_STATUS,
    LEFT_TARGET,
    RIGHT_TARGET,
    ROBOT_CONFIG,
    ROBOT_DESCRIPTION,
    SESSION_PHASE,
)
from recorders.protocol.frames import MAX_PAYLOAD, NO_RUN, Frame, FrameType, pack
from recorders.protocol.receiver import FAREWELL_WAIT_S
from recorders.protocol.stream import Offer, Progress
from recorders.reading.reader import LogReader
from recorders.recording.config import RecordConfig, RecordingStats
from recorders.recording.live_recorder import LiveRecorder
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport


@contextmanager
def recorder(folder: Path, *options: object) -> Iterator[tuple[zenoh.Session, subprocess.Popen[str]]]:
    """Start a recorder; yields a session that it hears, and its process."""
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with start("record", "--out", "log.mcap", "--connect", endpoint, "--json", *options, cwd=folder) as process:
            wait_for_line(process, "records reenact/**")
            wait_for_subscriber(session)
            yield session, process
            process.kill()


@contextmanager
def endless_replay(log: Path, endpoint: str) -> Iterator[subprocess.Popen[str]]:
    arguments = ("--epochs", 100_000, "--connect", endpoint, "--await", "recorder", "--wait", 120)
    with start("replay", log, *arguments, cwd=log.parent) as process:
        yield process
        process.kill()


@contextmanager
def recording_endlessly(log: Path) -> Iterator[tuple[subprocess.Popen[str], subprocess.Popen[str]]]:
    """A recorder that writes `run.mcap` beside the log, and the endless replay that awaits it, under way."""
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))),
        start("record", "--out", "run.mcap", "--connect", endpoint, "--json", cwd=log.parent) as process,
    ):
        wait_for_line(process, "records reenact/**")
        with endless_replay(log, endpoint) as replay:
            wait_for_line(process, "takes run")
            yield process, replay


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> dict[str, Any]:
    process.send_signal(number)
    printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    return dict(json.loads(printed))


def stop_once_all_is_there(
    session: zenoh.Session, process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT
) -> dict[str, Any]:
    """Stop a recorder when it has what was put before."""
    await_arrival(session)
    return stop(process, number)


def bare(record: RecordedMessage) -> tuple[str, int, bytes]:
    return record.topic, record.sequence, record.data


def await_arrival(session: zenoh.Session) -> None:
    """Wait until the recorder answers: what was put before the question has come there before it."""
    replies = session.get("reenact/@consumer/recorder/status", timeout=120)
    assert any(reply.ok is not None for reply in replies)


def pose(index: int) -> PoseStamped:
    return PoseStamped(index * 1_000, [0.1 * index, 0.2, 0.3])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_producers_messages_keep_their_numbers_and_bytes(tmp_path: Path, number: signal.Signals) -> None:
    with recorder(tmp_path) as (session, process):
        with TopicPublisher(session) as producer:
            sent = [producer.publish(LEFT_TARGET, pose(index), log_time_ns=0) for index in range(500)]
        result = stop_once_all_is_there(session, process, number)
    recorded = list(LogReader(tmp_path / "log.mcap"))
    assert [(record.topic, record.sequence, record.data) for record in recorded] == [
        (record.topic, record.sequence, record.data) for record in sent
    ]
    assert result["messages"] == 500
    assert result["gaps"] == {}
    assert LogReader(tmp_path / "log.mcap").manifest["complete"] is True


def test_a_bag_is_recorded_whose_parts_its_metadata_name(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with start(
            "record", "--bag", "run", "--split", "4kB", "--connect", endpoint, "--json", cwd=tmp_path
        ) as process:
            wait_for_line(process, "records reenact/**")
            wait_for_subscriber(session)
            with TopicPublisher(session) as producer:
                sent = [producer.publish(LEFT_TARGET, pose(index), log_time_ns=0) for index in range(100)]
            result = stop_once_all_is_there(session, process)
    assert len(result["paths"]) > 1
    found = list(open_log(tmp_path / "run"))
    assert [bare(record) for record in found] == [bare(record) for record in sent]


def test_a_bag_takes_no_other_name_and_no_folder_with_files(tmp_path: Path) -> None:
    both = complaint(reenact_here("record", "--bag", "run", "--out", "a.mcap", cwd=tmp_path))
    assert "--bag: expected a new folder" in both
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "old").touch()
    assert "found old in it" in complaint(reenact_here("record", "--bag", "run", cwd=tmp_path))


def test_nothing_is_left_of_a_bag_that_was_never_begun(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        assert "something else listens there" in complaint(
            reenact_here("record", "--bag", "run", "--listen", endpoint, cwd=tmp_path)
        )
    assert not (tmp_path / "run").exists()


def test_gaps_are_counted(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        with TopicPublisher(session) as producer:
            records = [producer.publish(RIGHT_TARGET, pose(0), log_time_ns=0)]
        for sequence in (1, 2, 6, 7, 10):
            frame = Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (records[0]._replace(sequence=sequence),))
            payload, attachment = pack(frame)
            session.put(message_key("reenact", RIGHT_TARGET), payload, attachment=attachment)
        with TopicPublisher(session) as one, TopicPublisher(session) as other:  # each with numbers of its own
            for each in (one, one, one, other, one, other, one, other):
                each.publish(LEFT_TARGET, pose(0), log_time_ns=0)
        result = stop_once_all_is_there(session, process)
    assert result["gaps"] == {RIGHT_TARGET: 5}


def test_a_late_message_is_no_second_gap(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        for sequence in (0, 5, 3, 6, 0, 1):  # 0: the producer begins anew
            record = RecordedMessage(RIGHT_TARGET, PoseStamped.TYPE, encode(pose(0)), sequence, 0)
            frame = Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (record,))
            payload, attachment = pack(frame)
            session.put(message_key("reenact", RIGHT_TARGET), payload, attachment=attachment)
        result = stop_once_all_is_there(session, process)
    assert (result["gaps"], result["messages"]) == ({RIGHT_TARGET: 4}, 6)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_had_arrived_when_it_was_stopped_is_recorded(tmp_path: Path, number: signal.Signals) -> None:
    payload = random.Random(1).randbytes(8 << 20)  # it is received far faster than it is written
    with recorder(tmp_path) as (session, process):
        with session.declare_publisher("reenact/raw", congestion_control=zenoh.CongestionControl.BLOCK) as publisher:
            for _ in range(15):
                publisher.put(payload)
        await_arrival(session)
        process.send_signal(number)
        printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    result = json.loads(printed)
    assert result["messages"] == 15
    assert result["refused"] == {}
    assert LogReader(tmp_path / "log.mcap").counts == {"/raw": 15}


def test_a_foreign_attachment_keeps_nothing_from_being_recorded_and_what_is_refused_is_counted(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        for key, payload, attachment in (
            ("hand/left/target", encode(pose(1)), bytes(33)),
            ("notes", b"{}", b"hello"),
            ("large", bytes(MAX_PAYLOAD + 1), None),
            ("replay/batch", b"no batch", b"hello"),
        ):
            blocking = zenoh.CongestionControl.BLOCK
            session.put(f"reenact/{key}", payload, attachment=attachment, congestion_control=blocking)
        session.delete("reenact/notes")
        result = stop_once_all_is_there(session, process)
    recorded = {record.topic: record for record in LogReader(tmp_path / "log.mcap")}
    assert recorded[LEFT_TARGET].data == encode(pose(1))
    assert recorded["/notes"].data == b"{}"
    assert (result["messages"], result["opaque"]) == (2, {"/notes": 1})
    assert isinstance(result["refused"], dict)
    assert sorted(reason.split(": ")[0] for reason in result["refused"]) == ["/large", "/replay/batch"]


def test_what_is_not_of_the_type_that_its_encoding_names_is_opaque(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        for name, payload in (("junk", b"junk"), ("pose", encode(pose(1)))):
            session.put(f"reenact/a/{name}", payload, encoding=f"application/cdr;{PoseStamped.TYPE}")
        session.put("reenact/a/image", b"\x00\x01\x00\x00\xff\xff", encoding="application/cdr;sensor_msgs/msg/Image")
        result = stop_once_all_is_there(session, process)
    recorded = {record.topic: record.type for record in LogReader(tmp_path / "log.mcap")}
    assert recorded == {"/a/junk": "", "/a/pose": PoseStamped.TYPE, "/a/image": ""}
    assert result["opaque"] == {"/a/junk": 1, "/a/image": 1}


def test_anybodys_messages_are_recorded_and_what_is_no_ros_message_is_opaque(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        plain = {"camera/raw": b"\x00\x01\x02", "hand/left/target": b"no pose at all", "notes": b"{}"}
        for key, payload in plain.items():
            session.put(f"reenact/{key}", payload)
        with TopicPublisher(session) as producer:
            producer.publish("/my/values", Float64MultiArray([1.0, 2.0]), log_time_ns=0)
            producer.publish(LEARNER_OUTPUT, Float64MultiArray([3.0]), log_time_ns=0)
        result = stop_once_all_is_there(session, process)
    recorded = {record.topic: record for record in LogReader(tmp_path / "log.mcap")}
    assert {topic: recorded[topic].data for topic in ("/camera/raw", "/hand/left/target", "/notes")} == {
        f"/{key}": payload for key, payload in plain.items()
    }
    assert recorded["/my/values"].type == Float64MultiArray.TYPE
    assert recorded[LEARNER_OUTPUT].type == Float64MultiArray.TYPE
    assert recorded["/hand/left/target"].type == ""
    assert result["opaque"] == {"/camera/raw": 1, "/hand/left/target": 1, "/notes": 1}


def test_a_topic_too_many_for_a_log_is_refused_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("recorders.writing.writer.MAX_CHANNELS", 3)
    with recording_here(tmp_path / "log.mcap") as (producer, live, stopped):
        for index in range(20):
            producer.publish(f"/values/{index % 5}", Float64MultiArray([1.0]), log_time_ns=0)
        wait_until(lambda: live.recording.messages + live.recording.refused.total() == 20)
        stopped()
    assert LogReader(tmp_path / "log.mcap").counts == {f"/values/{index}": 4 for index in range(3)}
    assert caplog.messages == ["refused a message on one topic more: a log holds no more than 65535 channels"]


def test_topics_are_chosen(tmp_path: Path) -> None:
    with recorder(tmp_path, "--include", "/hand/*", "--exclude", "/hand/right/*") as (session, process):
        with TopicPublisher(session) as producer:
            for topic in (LEFT_TARGET, RIGHT_TARGET):
                producer.publish(topic, pose(1), log_time_ns=0)
            producer.publish(LEARNER_OUTPUT, Float64MultiArray([3.0]), log_time_ns=0)
        stop_once_all_is_there(session, process)
    assert LogReader(tmp_path / "log.mcap").counts == {LEFT_TARGET: 1}


def test_files_are_split_by_size(tmp_path: Path) -> None:
    with recorder(tmp_path, "--split", "10KB") as (session, process):
        with TopicPublisher(session) as producer:
            for index in range(300):
                producer.publish(LEFT_TARGET, pose(index), log_time_ns=0)
        result = stop_once_all_is_there(session, process)
    assert isinstance(result["paths"], list)
    assert len(result["paths"]) > 2
    assert [record.sequence for record in open_log(tmp_path / "log.mcap")] == list(range(300))
    Path(tmp_path, result["paths"][-1]).unlink()
    with pytest.raises(LogError, match=f"part {len(result['paths']) - 1} is missing"):
        open_log(tmp_path)


@contextmanager
def recording_here(
    out: Path, **options: Any
) -> Iterator[tuple[TopicPublisher, LiveRecorder, Callable[[], RecordingStats]]]:
    """Record in this process; yields who is recorded, the recorder, and what stops it and returns the recording."""
    over, endpoint = threading.Event(), free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as elsewhere,
        TopicPublisher(elsewhere) as producer,
        Receiver(session, config=ReceiverConfig(name="recorder", live=True)) as receiver,
        ThreadPoolExecutor() as pool,
        ExitStack() as stack,
    ):
        stack.callback(over.set)  # or the recorder would outlive a test that fails
        live = LiveRecorder(out, **options)
        recording = pool.submit(live.run, receiver, stopped=over.is_set)
        wait_for_subscriber(elsewhere)

        def stopped() -> RecordingStats:
            over.set()
            return recording.result(timeout=120)

        yield producer, live, stopped


def test_files_are_split_by_time_and_none_is_empty(tmp_path: Path) -> None:
    looks: list[RecordingStats] = []
    options = {"config": RecordConfig(split_ns=1), "on_progress": looks.append}
    with (
        recording_here(tmp_path / "log.mcap", **options) as (producer, live, stopped),
    ):
        wait_until(lambda: len(looks) > 2)
        assert [path.name for path in tmp_path.iterdir()] == ["log_000.mcap.part"]
        for index in range(3):
            producer.publish(LEFT_TARGET, pose(index), log_time_ns=0)
        wait_until(lambda: live.recording.messages == 3)
        paths = stopped().paths
    assert [path.name for path in paths] == ["log_000.mcap", "log_001.mcap", "log_002.mcap"]
    assert [[record.sequence for record in LogReader(path)] for path in paths] == [[0], [1], [2]]


def test_log_time_never_falls_whatever_the_clock_on_the_wall_does(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    now_ns = 1_700_000_000_000_000_001
    shown = iter([0, 0, 5, 5 - 3600 * 10**9, -now_ns, 6])  # the first names the file
    with (
        recording_here(tmp_path / "log.mcap", clock=lambda: now_ns + next(shown)) as (producer, live, stopped),
    ):
        for index in range(5):
            producer.publish(LEFT_TARGET, pose(index), log_time_ns=0)
        wait_until(lambda: live.recording.messages == 5)
        stopped()
    times_ns = [record.log_time_ns - now_ns for record in LogReader(tmp_path / "log.mcap")]
    assert times_ns == [0, 5, 5, 5, 6]
    assert caplog.messages == ["the clock on the wall stepped back by 3600 s: log time waits until it has caught up"]


def test_an_awaited_recorder_misses_nothing_of_a_replay_and_its_log_trains_as_recorded(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        arguments = ("record", "--out", "run.mcap", "--connect", endpoint, "--stop-at-stream-end", "--json")
        with start(*arguments, cwd=tmp_path) as process:
            wait_for_line(process, "records reenact/**")
            awaited = ("--await", "recorder", "--wait", 120, "--connect", endpoint)
            replayed = reenact("replay", log, "--epochs", 3, *awaited, "--json", cwd=tmp_path)
            assert replayed.returncode == 0, replayed.stderr
            process.communicate(timeout=120)
    recorded = reenact_here("train", "run.mcap", "--as-recorded", "--out", "a.npz", "--json", cwd=tmp_path)
    direct = reenact_here("train", log, "--epochs", 3, "--out", "b.npz", "--json", cwd=tmp_path)
    assert recorded.returncode == 0, recorded.stderr
    for key in ("digest", "stream_digest", "steps", "ticks", "train_cm"):
        assert json.loads(recorded.stdout)[key] == json.loads(direct.stdout)[key]
    assert reenact_here("diff", "a.npz", "b.npz", cwd=tmp_path).returncode == 0


def test_the_recording_of_a_live_session_has_the_robots_description_and_the_learners_last_words(
    tmp_path: Path,
) -> None:
    endpoint, robot = free_endpoint(), load_robot("asimo")
    consumers = {"learn": ("--out", "c.npz"), "record": ("--out", "session.mcap", "--stop-at-stream-end", "--json")}
    with live_robot(endpoint), ExitStack() as stack:
        for verb, options in consumers.items():
            process = stack.enter_context(start(verb, *options, "--connect", endpoint, cwd=tmp_path))
            stack.callback(process.kill)
        explorer = stack.enter_context(
            spawn(
                "explore",
                connect=endpoint,
                motion=str(write_short_motion(tmp_path / "short.csv")),
                seed=3,
                phases=[["washout", 1], ["learn", 1], ["evaluate", 1]],
                settle_ns=100_000_000,
                consumers=["learner", "recorder"],
            )
        )
        _, complaints = explorer.communicate(timeout=120)
        assert explorer.returncode == 0, complaints
        result = json.loads(process.communicate(timeout=120)[0])
    recorded = list(LogReader(tmp_path / "session.mcap"))
    counts = Counter(record.topic for record in recorded)
    assert [counts[topic] for topic in (SESSION_PHASE, LEARNER_DIGEST, LEARNER_STATUS, LEARNER_ERROR)] == [3, 3, 3, 1]
    for topic, text in ((ROBOT_DESCRIPTION, robot.urdf_text), (ROBOT_CONFIG, robot.toml_text)):
        (description,) = (record for record in recorded if record.topic == topic)
        assert decode_as(String, description.data).data == text
        assert recorded.index(description) < [record.topic for record in recorded].index(SESSION_PHASE)
    assert result["gaps"] == {}
    said = [record for record in recorded if record.topic == LEARNER_DIGEST]
    learned = Controller.load(tmp_path / "c.npz")
    assert json.loads(decode_as(String, said[-1].data).data)["state"] == learned.digest


def test_stop_at_stream_end_waits_for_as_long_as_the_sender_awaits_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorders.protocol.questions.ALIVE_S", 0.02)  # far more often than it must
    clock, longer_s = SteppedClock(monkeypatch), round(2 * FAREWELL_WAIT_S)
    log = write_episode(tmp_path / "episode.mcap", samples=4)
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as elsewhere,
        open_session(SessionConfig(connect=(endpoint,))) as sending,
        Receiver(session, config=ReceiverConfig(name="recorder", live=True)) as receiver,
        Receiver(elsewhere) as slow,
        TopicPublisher(elsewhere) as producer,
        ThreadPoolExecutor() as pool,
        ExitStack() as stack,
    ):
        last_words = Last(
            lambda: clock.pass_with_signs_of_life(receiver, longer_s),  # than a silent sender is waited for
            lambda: producer.publish(LEARNER_OUTPUT, Float64MultiArray([1.0]), log_time_ns=0),
        )
        over = threading.Event()
        stack.callback(over.set)  # or the recorder would outlive a test that fails
        live = LiveRecorder(tmp_path / "run.mcap")
        recording = pool.submit(live.run, receiver, stopped=over.is_set, stop_at_stream_end=True)
        consuming = pool.submit(slow.serve, last_words)
        source = Replay([log], Schedule(epochs=1))
        config = SenderConfig(consumers=("recorder", "learner"), wait_s=120.0)
        ZenohTransport(sending, config=config).deliver(source.offer(), source.stream)
        consuming.result(timeout=120)
        recording.result(timeout=120)
    assert LogReader(tmp_path / "run.mcap").counts[LEARNER_OUTPUT] == 1


class Last:
    """A consumer that takes the whole stream, waits, and publishes or fails only then."""

    def __init__(self, wait: Callable[[], object], say: Callable[[], object]) -> None:
        self._wait = wait
        self._say = say

    def hello(self, offer: Offer) -> int:
        return 0

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        count = len(list(messages))
        self._wait()
        self._say()
        return {"count": count}


def await_result(session: zenoh.Session) -> None:
    """Wait until the recorder has reported what it made of the stream."""

    def has_reported() -> bool:
        replies = session.get("reenact/@consumer/recorder/status", timeout=120.0)
        return any(
            Progress.from_json(reply.ok.payload.to_bytes()).result is not None
            for reply in replies
            if reply.ok is not None
        )

    wait_until(has_reported)


def test_stop_at_stream_end_is_the_end_too_when_another_who_was_awaited_fails(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=4)
    endpoint = free_endpoint()

    def fail() -> None:
        raise WireError("nothing comes of it")

    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        Receiver(session) as receiver,
        ThreadPoolExecutor() as pool,
        start(
            "record", "--stop-at-stream-end", "--out", "run.mcap", "--connect", endpoint, "--json", cwd=tmp_path
        ) as process,
    ):
        last = Last(lambda: await_result(session), fail)
        consuming = pool.submit(receiver.serve, last, wait_s=120.0)
        arguments = ("--epochs", 1, "--connect", endpoint, "--await", "recorder", "--await", "learner", "--wait", 120)
        replayed = reenact("replay", log, *arguments, cwd=tmp_path)
        assert "learner: nothing comes of it" in complaint(replayed)
        assert isinstance(consuming.exception(timeout=120), WireError)
        printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    assert json.loads(printed)["broken"] == []
    assert LogReader(tmp_path / "run.mcap").counts[SESSION_PHASE] == 7


def test_a_stream_whose_sender_is_killed_leaves_a_sound_log(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    with recording_endlessly(log) as (process, replay):
        wait_until(lambda: bool(so_far(tmp_path / "run.mcap.part")))
        replay.kill()
        result = stop(process)
    records = list(LogReader(tmp_path / "run.mcap"))
    assert len(records) == result["messages"] > 0
    assert result["broken"] == ["the recorder was stopped"]
    sent = Replay([log], Schedule(epochs=100_000)).stream()
    assert [bare(record) for record in records] == [bare(record) for record in islice(sent, len(records))]


def test_a_recorder_that_is_stopped_tells_the_sender(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    with recording_endlessly(log) as (process, replay):
        stop(process)
        said = replay.communicate(timeout=120)[1]
    assert replay.returncode == 2
    assert said.endswith("reenact: recorder: the recorder was stopped\n")


def test_a_sender_that_comes_back_too_late_is_told_so_and_nothing_more_of_it_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    endpoint, over = free_endpoint(), threading.Event()
    config = ReceiverConfig(name="recorder", live=True)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        Receiver(session, config=config) as receiver,
        ThreadPoolExecutor() as pool,
        ExitStack() as stack,
    ):
        live = LiveRecorder(tmp_path / "run.mcap")
        recording = pool.submit(live.run, receiver, stopped=over.is_set)
        with endless_replay(log, endpoint) as replay:
            stack.callback(over.set)  # or the recorder would outlive a test that fails
            wait_until(lambda: live.recording.messages > 0)
            replay.send_signal(signal.SIGSTOP)
            monkeypatch.setattr(receiver._machine, "_silence_s", 0.5)  # only now: it may have been slow before
            wait_until(lambda: bool(live.recording.broken))
            messages = live.recording.messages
            replay.send_signal(signal.SIGCONT)
            said = replay.communicate(timeout=120)[1]
        over.set()
        result = recording.result(timeout=120)
    assert replay.returncode == 2
    assert "reenact: recorder: the sender fell silent" in said
    assert (result.messages, result.gaps, len(result.broken)) == (messages, {}, 1)


def test_two_recorders_of_one_name_are_one_too_many(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        with start("record", "--out", "a.mcap", "--connect", endpoint, "--json", cwd=tmp_path) as process:
            wait_for_line(process, "records reenact/**")
            (tmp_path / "b.mcap.part").write_bytes(b"what a crash left")
            second = reenact("record", "--out", "b.mcap", "--connect", endpoint, cwd=tmp_path)
            assert "a consumer 'recorder' is in namespace 'reenact' already" in complaint(second)
            stop(process)
    assert not (tmp_path / "b.mcap").exists()
    assert (tmp_path / "b.mcap.part").read_bytes() == b"what a crash left"  # it recorded nothing, and moved nothing


@pytest.mark.parametrize(
    ("options", "published", "said"),
    [
        ((), False, "nothing is recorded: nobody published on reenact/**, or this session may not read it;"),
        (
            ("--exclude", "*"),
            True,
            "nothing is recorded: no message that came on reenact/** (1) is on a topic to record",
        ),
        (("--exclude", "/notes"), False, "nothing is recorded: nobody published on reenact/**,"),
    ],
)
def test_a_recorder_that_has_nothing_says_why(
    tmp_path: Path, options: tuple[str, ...], published: bool, said: str
) -> None:
    with recorder(tmp_path, *options) as (session, process):
        if published:
            session.put("reenact/notes", b"{}")
        await_arrival(session)
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=120)
    assert process.returncode == 0
    assert complaints.startswith(said)
    assert complaints.count("\n") == 1


def test_a_recorder_says_where_it_is(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with start("record", "--out", "log.mcap", "--listen", endpoint, cwd=tmp_path) as process:
        line = wait_for_line(process, "records")
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=120)
    assert line == f"recorder records reenact/** at {endpoint} to log.mcap; Ctrl-C ends it\n"
    shown = [row.split() for row in printed.splitlines()]
    assert shown == [["paths", "log.mcap"], ["messages", "0"], ["bytes", "0"]]  # nothing of what is not


def test_a_recorder_that_connects_says_what_it_waits_for_before_it_waits(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with start("record", "--out", "log.mcap", "--connect", endpoint, cwd=tmp_path) as process:
        line = wait_for_line(process, "")  # nobody is there
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
    assert line == f"recorder waits for {endpoint}, to record reenact/**\n"


def test_a_name_that_is_taken_is_said_before_anybody_is_looked_for(tmp_path: Path) -> None:
    (tmp_path / "there.mcap").write_bytes(b"")
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):  # so that another cannot
        for name, expected in (("there.mcap", "there.mcap exists"), ("new.mcap", "something else listens there")):
            assert expected in complaint(reenact_here("record", "--out", name, "--listen", endpoint, cwd=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["there.mcap"]


def test_bad_input_is_one_clear_line(tmp_path: Path) -> None:
    for name in ("there.mcap", "parts_2.mcap"):
        (tmp_path / name).write_bytes(b"")
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        for options, expected in (
            (("--out", "there.mcap"), "there.mcap exists"),
            (("--out", "parts.mcap", "--split", "1h"), "parts_2.mcap exists"),
            (("--out", "log.mcap", "--split", "10 apples"), "--split"),
            (("--out", "nowhere/log.mcap"), "nowhere"),
        ):
            assert expected in complaint(reenact_here("record", *options, "--connect", endpoint, cwd=tmp_path))


def test_recording_needs_no_drake(tmp_path: Path) -> None:
    program = (
        "import sys, recorders.recording.live_recorder; "
        "print(sorted({'pydrake', 'pinocchio', 'numba'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"
