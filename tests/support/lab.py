"""A lab's recording, made up: joints and a tracker with rates and stamps of their own, and what may be wrong in it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sessions import write_foreign

from pipeline.cli import app
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.coordinates import to_rows
from pipeline.robot.kinematics import Kinematics
from recorders.cdr.codec import encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

MS = 10**6
START = 1_764_000_000 * 10**9
SECONDS = 8
MAPPED = ("--map", "/tracker=/hand/tip/measured")


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app.main([str(argument) for argument in arguments])
    return int(end.value.code or 0)


def posture(robot: RobotConfig, time_s: float) -> Any:
    """Return a posture that goes about the comfortable one, never the same way twice."""
    waves = [math.sin((0.9 + 0.37 * place) * time_s + place) for place in range(len(robot.joints))]
    return robot.comfort + 0.25 * np.array(waves)


def recording(folder: Path, *, tracked: bool = True) -> list[RecordedMessage]:
    """Return what a lab records: joints and a gripper at 100 Hz, a tracker at 30 Hz, each with stamps of its own.

    The tracker measures the first hand, and how it is turned where that counts.
    """
    robot = load_robot(folder)
    kinematics = Kinematics(robot)
    names = ("gripper", *robot.joints[::-1])
    records = []
    for index in range(SECONDS * 100):
        stamp = START + index * 10 * MS + index % 7 * 30_000
        values = np.array([0.02, *posture(robot, (stamp - START) * 1e-9)[::-1]])
        message = JointState(stamp, names, values, velocity=np.full(len(names), math.nan))
        records.append(RecordedMessage("/joint_states", message.TYPE, encode(message), index, stamp + 2 * MS))
    for index in range(SECONDS * 30 if tracked else 0):
        stamp = START + index * 33_333_333 + 5 * MS
        row = to_rows(robot, kinematics.inputs(posture(robot, (stamp - START) * 1e-9)))[0]
        turn = {"orientation": row[3:]} if len(row) > 3 else {}
        tracker = PoseStamped(stamp, row[:3], frame_id="world", **turn)
        records.append(RecordedMessage("/tracker", tracker.TYPE, encode(tracker), index, stamp + 9 * MS))
    return sorted(records, key=lambda record: record.log_time_ns)


def holed(robot: Path, path: Path) -> Path:
    """Write a recording with a second in which nothing was recorded."""
    return write_foreign(path, [r for r in recording(robot) if not 3 * 10**9 < r.log_time_ns - START < 4 * 10**9])


def changed(records: list[RecordedMessage], topic: str, change: Any) -> list[RecordedMessage]:
    """Return messages of which those of one topic are others."""
    from recorders.cdr.codec import decode

    found = []
    for record in records:
        if record.topic == topic:
            message: Any = decode(record.type, record.data)
            record = record._replace(data=encode(change(message, message.stamp_ns)))
        found.append(record)
    return found


def anew(records: list[RecordedMessage]) -> list[RecordedMessage]:
    """Return messages of whose stamps those of the second half are a day earlier."""
    half = len(records) // 2
    moved = changed(records[half:], "/tracker", lambda pose, stamp: replace(pose, stamp_ns=stamp - 86400 * 10**9))
    moved = changed(moved, "/joint_states", lambda state, stamp: replace(state, stamp_ns=stamp - 86400 * 10**9))
    return [*records[:half], *moved]
