"""`cat` prints messages of any recording, decoded by its own definitions, and what is published now."""

import json
from pathlib import Path
from typing import Any

import bags
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from processes import start, wait_for_line
from typer.testing import CliRunner
from waiting import wait_for_subscriber

from pipeline.cli import app as cli
from recorders.cdr.codec import encode
from recorders.errors import ReenactError
from recorders.messages.message_types import JointState
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

FORMS = {
    "ros1": lambda folder: bags.ros1_bag(folder / "log.bag"),
    "db3": lambda folder: bags.bag_folder(folder / "bag"),
    "cdr": lambda folder: bags.cdr_mcap(folder / "log.mcap"),
}


def printed(*words: object, status: int = 0) -> str:
    run = CliRunner().invoke(cli.app, ["cat", *map(str, words)])
    if status:
        assert isinstance(run.exception, ReenactError)
        return str(run.exception)
    assert run.exit_code == 0, run.exception
    return run.stdout


@pytest.mark.parametrize("form", FORMS)
def test_json_has_every_field_of_every_message(tmp_path: Path, form: str) -> None:
    path = FORMS[form](tmp_path)
    rows = [json.loads(line) for line in printed(path, "--json").splitlines()]
    assert [(row["topic"], row["log_time_ns"]) for row in rows] == [(t, time_ns) for t, _, time_ns in bags.messages()]
    joints = rows[3 * 1 + 1]["message"]  # of the second step: a transform came with the first
    stamp_ns = bags.START_NS + 10_000_000
    assert joints.pop("header") == {
        **({"seq": 7} if form == "ros1" else {}),
        "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9},
        "frame_id": "b",
    }
    assert joints == {
        "name": ["elbow", "wrist"],
        "position": [0.01, 0.02],
        "velocity": ["NaN", 0.5],
        "effort": [],
    }
    assert "reason" not in rows[0]


def test_lines_for_people_name_each_field(tmp_path: Path) -> None:
    shown = printed(bags.ros1_bag(tmp_path / "log.bag"), "--topic", "/od*", "-n", 1)
    assert shown.startswith("1700000000.000002 s  /odom  nav_msgs/Odometry  #0\n    header.seq: 7\n")
    assert "\n    pose.pose.orientation.w: 0.8\n" in shown
    assert "\n    twist.twist.angular.z: 6.0\n" in shown
    assert shown.count(" /odom ") == 1


def test_types_of_the_logs_own_and_others_that_nobody_can_read(tmp_path: Path) -> None:
    definition = b"Header header\nlab/Reading[] readings\nbyte[3] code\nbool on\n"
    definition += b"=" * 80 + b"\nMSG: lab/Reading\nfloat32 value\nstring unit\n"
    definition += b"=" * 80 + b"\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    data = b"\0\1\0\0" + (5).to_bytes(4, "little") + (6).to_bytes(4, "little") + b"\2\0\0\0w\0\0\0"
    data += b"\1\0\0\0" + np.float32(0.5).tobytes() + b"\2\0\0\0m\0" + b"abc" + b"\1"
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        own = writer.register_channel("/own", "cdr", writer.register_schema("lab/msg/Readings", "ros2msg", definition))
        odd = writer.register_channel("/odd", "flatbuffer", writer.register_schema("Odd", "flatbuffer", b"x"))
        writer.add_message(own, 1, data, 1)
        writer.add_message(own, 2, data[:-3], 2)
        writer.add_message(odd, 3, b"12345", 3)
        writer.finish()
    first, second, third = (json.loads(line) for line in printed(tmp_path / "log.mcap", "--json").splitlines())
    assert first["message"] == {
        "header": {"stamp": {"sec": 5, "nanosec": 6}, "frame_id": "w"},
        "readings": [{"value": 0.5, "unit": "m"}],
        "code": "YWJj",
        "on": True,
    }
    assert second["message"] is None
    assert second["error"].startswith("lab/msg/Readings: ")
    assert "encodings cdr, ros1, json, protobuf" in third["error"]
    assert third["bytes"] == 5
    assert "5 bytes: " in printed(tmp_path / "log.mcap", "--topic", "/odd")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "expected a recording, or --connect or --listen"),
        (["LOG", "--connect", "tcp/127.0.0.1:1"], "expected no recording beside them"),
        (["LOG", "--topic", "/nobody"], "no topic /nobody"),
        (["EMPTY"], "expected messages, found none"),
        (["TEXT"], "expected an MCAP file"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, words: list[Any], expected: str) -> None:
    bags.bag_folder(tmp_path / "EMPTY", count=0)
    bags.cdr_mcap(tmp_path / "LOG")
    (tmp_path / "TEXT").write_text("no log")
    found = printed(*[tmp_path / word if word.isupper() else word for word in words], status=2)
    assert expected in found
    assert "\n" not in found


def test_what_is_published_is_printed_until_enough(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    joints = JointState(5, ("elbow",), np.array([0.25]))
    with start("cat", "--listen", endpoint, "--topic", "/a*", "-n", "2", "--json", cwd=tmp_path) as process:
        wait_for_line(process, "Ctrl-C ends it")
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            wait_for_subscriber(session)
            for topic in ("/other", "/arm", "/arm"):
                session.put(
                    message_key("reenact", topic), encode(joints), encoding=f"application/cdr;{JointState.TYPE}"
                )
            output, _ = process.communicate(timeout=120)
    rows = [json.loads(line) for line in output.splitlines()]
    assert process.returncode == 0
    assert [(row["topic"], row["message"]["position"]) for row in rows] == [("/arm", [0.25])] * 2
