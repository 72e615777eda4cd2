"""`reenact demonstrate` from a file and from a live tracker of anyone's, in a process of its own."""

import json
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from here import reenact_here
from processes import complaint, reenact, start, wait_for_line
from shown import EPOCH_NS, RIGHT, TRACKER, line_of, poses_of, write_csv, write_log

from pipeline.cli.robot.demonstrate import demonstrate
from pipeline.exploration.live_paths import ListenConfig, subscribe_paths
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ConfigError, ReenactError
from recorders.messages import topics
from recorders.messages.message_types import PoseStamped
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import control_key, message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session


def demonstrated(run: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout))


def test_a_csv_becomes_an_episode(tmp_path: Path) -> None:
    times_s = np.arange(0.0, 0.81, 0.02)
    write_csv(tmp_path / "line.csv", "t,x,y,z", times_s, 100.0 * line_of(times_s))
    options = ("--hand", "right", "--scale", 0.01, "--hz", 5, "--seed", 3, "--json")
    result = demonstrated(reenact("demonstrate", "line.csv", "--out", "line.mcap", *options, cwd=tmp_path))
    assert result["ticks"] == 6
    assert result["source"]["name"] == "line.csv"
    manifest = LogReader(tmp_path / "line.mcap").manifest
    assert (manifest["content_sha256"], manifest["seed"]) == (result["content_sha256"], 3)
    targets = targets_of(tmp_path / "line.mcap")
    np.testing.assert_allclose(np.diff(targets, axis=0)[:4], [[0.0, 0.02, 0.01]] * 4, atol=2e-9)


def test_a_drawing_out_of_reach_is_one_clear_line(tmp_path: Path) -> None:
    line = complaint(reenact_here("demonstrate", "right_hand_spiral", "--scale", 3, "--out", "s.mcap", cwd=tmp_path))
    assert line.startswith("reenact: motion 'right_hand_spiral' is out of reach: at sample ")
    assert line.endswith("make it smaller, or choose to clip, skip or keep such samples")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("line.csv", {"topic": "/a"}, "--topic and --map: expected a log or the source live, found 'line.csv'"),
        ("line.csv", {"duration": 1.0}, "--idle-timeout and --wait: expected the source live beside them"),
        (
            "line.csv",
            {"remap": ["a:=b"]},
            "--ros, --remap, --humble, --duration, --idle-timeout and --wait: expected the source live",
        ),
        ("line.csv", {"wait": 1.0}, "--idle-timeout and --wait: expected the source live beside them"),
        ("line.csv", {"hand": "third"}, "--hand: expected left or right, found 'third'"),
        ("line.csv", {"plane": "y"}, "--plane: expected two axes, such as --plane=-x,y, found 'y'"),
        ("line.csv", {"hand": "left"}, "the header lacks columns"),
        ("waltz", {}, "cannot read motion 'waltz': no such file"),
        ("track.mcap", {}, f"no message on {topics.LEFT_TARGET} or {topics.RIGHT_TARGET}"),
        ("live", {"idle_timeout": 0.0}, "idle_timeout_s: expected above 0 s, found 0"),
        ("live", {"out": Path("no/such/folder.mcap")}, "expected a folder no/such, found none"),
        ("line.csv", {"out": Path("line.csv")}, "line.csv exists: choose another name, or replace it with --overwrite"),
    ],
)
def test_bad_usage_and_input_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, options: dict[str, Any], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_csv(Path("line.csv"), "t,rx,ry,rz", np.arange(2.0), line_of(np.arange(2.0)))
    write_log(Path("track.mcap"), {TRACKER: poses_of(np.arange(3.0))})
    with pytest.raises(ReenactError) as caught:
        demonstrate(source, **{"out": Path("out.mcap"), **options})
    assert message in str(caught.value)
    assert {path.name for path in tmp_path.iterdir()} == {"line.csv", "track.mcap"}


@contextmanager
def listening(folder: Path, *options: object) -> Iterator[tuple[zenoh.Session, subprocess.Popen[str]]]:
    endpoint = free_endpoint()
    arguments = ("demonstrate", "live", "--out", "live.mcap", "--listen", endpoint, "--align", "as-is", "--json")
    with start(*arguments, *options, cwd=folder) as process:
        wait_for_line(process, f"listens to {TRACKER}")
        with open_session(SessionConfig(connect=(endpoint,), wait_s=120.0)) as session:
            yield session, process
        process.kill()


def result_of(process: subprocess.Popen[str]) -> dict[str, Any]:
    printed, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    return dict(json.loads(printed))


def targets_of(path: Path) -> np.ndarray:
    records = LogReader(path).records(topics=[topics.RIGHT_TARGET])
    return np.array([decode_as(PoseStamped, record.data).position for record in records])


def test_a_tracker_with_our_attachment_is_followed_for_a_duration(tmp_path: Path) -> None:
    options = ("--map", f"{TRACKER}={topics.RIGHT_TARGET}", "--hand", "right", "--duration", 1.0)
    with listening(tmp_path, *options) as (session, process):
        with TopicPublisher(session) as producer:
            for pose in poses_of(np.arange(0.0, 1.5, 0.01)):
                producer.publish(TRACKER, pose, log_time_ns=0)
            result = result_of(process)
    assert result["ticks"] == 12
    assert result["source"]["kind"] == "live"
    np.testing.assert_allclose(targets_of(tmp_path / "live.mcap")[:11], line_of(0.1 * np.arange(11)), atol=2e-9)


def test_anybodys_poses_are_followed_until_ctrl_c_whatever_else_is_said(tmp_path: Path) -> None:
    poses = [encode(pose) for pose in poses_of(np.arange(0.0, 0.81, 0.02))]
    wild = encode(PoseStamped(EPOCH_NS + 10**17, RIGHT))
    with listening(tmp_path, "--topic", TRACKER, "--idle-timeout", 30) as (session, process):
        for payload in [*poses[:20], wild, *poses[20:], b"no pose"]:
            session.put(message_key("reenact", TRACKER), payload)
            session.put(message_key("reenact", "/camera"), bytes(100))
        wait_for_line(process, f"refused on {TRACKER}")  # what was put last: all before it has come
        process.send_signal(signal.SIGINT)
        result = result_of(process)
    assert result["ticks"] == 10
    assert result["source"]["left_out"] == {"right": {"stamp far ahead": 1}}
    np.testing.assert_allclose(targets_of(tmp_path / "live.mcap")[:9], line_of(0.1 * np.arange(9)), atol=2e-9)


def test_what_had_arrived_when_it_is_stopped_is_shown() -> None:
    endpoint = free_endpoint()
    poses = [encode(pose) for pose in poses_of(np.arange(0.0, 0.81, 0.02))]

    def stopped() -> bool:
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            for payload in poses:
                session.put(message_key("reenact", TRACKER), payload, congestion_control=zenoh.CongestionControl.BLOCK)
            asked = session.get(control_key("reenact", "demonstration", "status"), timeout=120.0)
            assert [reply.ok is not None for reply in asked] == [True]  # what was put before it has arrived
        return True

    config = ListenConfig(wait_s=120.0)
    session = SessionConfig(listen=(endpoint,))
    shown = subscribe_paths({TRACKER: "right"}, renames={}, session=session, config=config, stopped=stopped)
    assert len(shown.paths["right"].times_s) == len(poses)


def test_who_is_lost_and_back_is_said(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    peer = SessionConfig(listen=(endpoint,))
    with ExitStack() as stack:
        with open_session(peer):
            options = ("demonstrate", "live", "--out", "live.mcap", "--connect", endpoint)
            process = stack.enter_context(start(*options, cwd=tmp_path))
            wait_for_line(process, "listens to")
        wait_for_line(process, f"lost {endpoint} at 20")
        with open_session(peer):
            wait_for_line(process, f"back {endpoint} at 20")
        process.kill()


def test_idle_timeout_ends_a_live_demonstration_and_one_pose_is_none(tmp_path: Path) -> None:
    with listening(tmp_path, "--topic", TRACKER, "--idle-timeout", 0.3) as (session, process):
        session.put(message_key("reenact", TRACKER), encode(PoseStamped(EPOCH_NS, RIGHT)))
        _, said = process.communicate(timeout=120)
    assert process.returncode == 2
    assert said.splitlines()[-1] == "reenact: live: expected at least two poses of the right hand, found 1"
    assert list(tmp_path.iterdir()) == []


def test_nobody_who_shows_anything_is_waited_for_so_long_and_no_longer(tmp_path: Path) -> None:
    with listening(tmp_path, "--topic", TRACKER, "--wait", 1.5) as (session, process):
        session.put(message_key("reenact", "/camera"), bytes(100))
        _, said = process.communicate(timeout=120)
    assert process.returncode == 2
    assert said.splitlines()[-1].startswith(
        f"reenact: expected a pose on reenact{TRACKER} within 1.5 s, found none that can be used: does anybody publish"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("parameters", [{"idle_timeout_s": 0.0}, {"duration_s": -1.0}, {"wait_s": 0.0}])
def test_times_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="expected above 0 s"):
        ListenConfig(**parameters)
