"""The recorder: any publisher's messages to MCAP, in order, with gaps counted, finished cleanly whatever ends it."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh
from episodes import write_episode
from processes import complaint, reenact, start, wait_for_line

from recorders.messages import Float64MultiArray, PoseStamped
from recorders.reader import LogReader
from recorders.topics import LEARNER_OUTPUT, LEFT_TARGET, RIGHT_TARGET
from recorders.wire.frames import NO_RUN, Frame, Kind, message_key, pack
from recorders.wire.loopback import free_endpoint
from recorders.wire.producer import Producer
from recorders.wire.session import SessionConfig, open_session


@contextmanager
def recorder(folder: Path, *options: object) -> Iterator[tuple[zenoh.Session, subprocess.Popen[str]]]:
    """Start a recorder; yields a session that it hears, and its process."""
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with start("record", "--out", "log.mcap", "--connect", endpoint, "--json", *options, cwd=folder) as process:
            try:
                wait_for_line(process, "records reenact/**")
                yield session, process
            finally:
                process.kill()


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> dict[str, object]:
    time.sleep(0.5)  # what was put last is on its way
    process.send_signal(number)
    printed, complaints = process.communicate(timeout=30)
    assert process.returncode == 0, complaints
    return dict(json.loads(printed))


def pose(index: int) -> PoseStamped:
    return PoseStamped(index * 1_000, [0.1 * index, 0.2, 0.3])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_producers_messages_keep_their_numbers_and_bytes(tmp_path: Path, number: signal.Signals) -> None:
    with recorder(tmp_path) as (session, process):
        with Producer(session) as producer:
            sent = [producer.publish(LEFT_TARGET, pose(index), log_time_ns=0) for index in range(500)]
        result = stop(process, number)
    recorded = list(LogReader(tmp_path / "log.mcap"))
    assert [(record.topic, record.sequence, record.data) for record in recorded] == [
        (record.topic, record.sequence, record.data) for record in sent
    ]
    assert result["messages"] == 500
    assert result["gaps"] == {}
    assert LogReader(tmp_path / "log.mcap").manifest["complete"] is True


def test_gaps_are_counted(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        with Producer(session) as producer:
            records = [producer.publish(RIGHT_TARGET, pose(0), log_time_ns=0)]
        for sequence in (1, 2, 6, 7, 10):
            frame = Frame(Kind.MESSAGE, NO_RUN, NO_RUN, 0, (records[0]._replace(sequence=sequence),))
            payload, attachment = pack(frame)
            session.put(message_key("reenact", RIGHT_TARGET), payload, attachment=attachment)
        result = stop(process)
    assert result["gaps"] == {RIGHT_TARGET: 5}


def test_anybodys_messages_are_recorded_and_what_is_no_ros_message_is_opaque(tmp_path: Path) -> None:
    with recorder(tmp_path) as (session, process):
        plain = {"camera/raw": b"\x00\x01\x02", "hand/left/target": b"no pose at all", "notes": b"{}"}
        for key, payload in plain.items():
            session.put(f"reenact/{key}", payload)
        with Producer(session) as producer:
            producer.publish("/my/values", Float64MultiArray([1.0, 2.0]), log_time_ns=0)
            producer.publish(LEARNER_OUTPUT, Float64MultiArray([3.0]), log_time_ns=0)
        result = stop(process)
    recorded = {record.topic: record for record in LogReader(tmp_path / "log.mcap")}
    assert {topic: recorded[topic].data for topic in ("/camera/raw", "/hand/left/target", "/notes")} == {
        f"/{key}": payload for key, payload in plain.items()
    }
    assert recorded["/my/values"].type == Float64MultiArray.TYPE
    assert recorded[LEARNER_OUTPUT].type == Float64MultiArray.TYPE
    assert recorded["/hand/left/target"].type == ""
    assert result["opaque"] == {"/camera/raw": 1, "/hand/left/target": 1, "/notes": 1}


def test_topics_are_chosen(tmp_path: Path) -> None:
    with recorder(tmp_path, "--include", "/hand/*", "--exclude", "/hand/right/*") as (session, process):
        with Producer(session) as producer:
            for topic in (LEFT_TARGET, RIGHT_TARGET):
                producer.publish(topic, pose(1), log_time_ns=0)
            producer.publish(LEARNER_OUTPUT, Float64MultiArray([3.0]), log_time_ns=0)
        stop(process)
    assert LogReader(tmp_path / "log.mcap").counts == {LEFT_TARGET: 1}


def test_files_are_split_by_size(tmp_path: Path) -> None:
    with recorder(tmp_path, "--split", "10KB") as (session, process):
        with Producer(session) as producer:
            for index in range(300):
                producer.publish(LEFT_TARGET, pose(index), log_time_ns=0)
        result = stop(process)
    assert isinstance(result["paths"], list)
    assert len(result["paths"]) > 2
    sequences = [record.sequence for path in result["paths"] for record in LogReader(tmp_path / path)]
    assert sequences == list(range(300))


def test_an_awaited_recorder_misses_nothing_of_a_replay_and_its_log_trains_as_recorded(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        arguments = ("record", "--out", "run.mcap", "--connect", endpoint, "--until-end", "--json")
        with start(*arguments, cwd=tmp_path) as process:
            wait_for_line(process, "records reenact/**")
            replaying = ("replay", log, "--epochs", 3, "--connect", endpoint, "--await", "recorder", "--json")
            replayed = reenact(*replaying, cwd=tmp_path)
            assert replayed.returncode == 0, replayed.stderr
            process.communicate(timeout=60)
    recorded = reenact("train", "run.mcap", "--as-recorded", "--out", "a.npz", "--json", cwd=tmp_path)
    direct = reenact("train", log, "--epochs", 3, "--out", "b.npz", "--json", cwd=tmp_path)
    assert recorded.returncode == 0, recorded.stderr
    for key in ("digest", "stream_digest", "steps", "ticks", "train_cm"):
        assert json.loads(recorded.stdout)[key] == json.loads(direct.stdout)[key]
    assert reenact("diff", "a.npz", "b.npz", cwd=tmp_path).returncode == 0


def test_a_stream_whose_sender_is_killed_leaves_a_sound_log(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "episode.mcap", samples=20)
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        with start("record", "--out", "run.mcap", "--connect", endpoint, "--json", cwd=tmp_path) as process:
            wait_for_line(process, "records reenact/**")
            endless = ("replay", log, "--epochs", 100_000, "--connect", endpoint, "--await", "recorder")
            with start(*endless, cwd=tmp_path) as replay:
                wait_for_line(process, "takes run")
                time.sleep(1.0)
                replay.kill()
            result = stop(process)
    records = list(LogReader(tmp_path / "run.mcap"))
    assert len(records) == result["messages"] > 0


def test_bad_input_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "there.mcap").write_bytes(b"")
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        for options, expected in (
            (("--out", "there.mcap"), "there.mcap exists"),
            (("--out", "log.mcap", "--split", "10 apples"), "--split"),
            (("--out", "nowhere/log.mcap"), "nowhere"),
        ):
            assert expected in complaint(reenact("record", *options, "--connect", endpoint, cwd=tmp_path))


def test_recording_needs_no_drake(tmp_path: Path) -> None:
    program = "import sys, recorders.live; print(sorted({'pydrake', 'pinocchio', 'numba'} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"
