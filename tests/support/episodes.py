"""Small logs made without a simulator: the teacher's own postures, as if the robot followed at once."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline.motions.patterns.circles import circles
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher
from recorders.messages.message_types import JointState, Message, PoseStamped
from recorders.messages.topics import LEFT_MEASURED, LEFT_TARGET, RIGHT_MEASURED, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.writing.writer import LogWriter

PERIOD_NS = 200_000_000
STEPS_PER_TICK = 40

Change = Callable[[int, str, Message], Sequence[tuple[str, Message]]]
"""What becomes of a message: given tick, topic and message, what is written instead."""


def as_it_is(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
    return [(topic, message)]


def write_episode(
    path: Path, *, samples: int = 24, change: Change = as_it_is, attachments: dict[str, bytes] | None = None
) -> Path:
    """Write the ticks of the first `samples` samples of the circles, and one more."""
    robot = load_robot("asimo")
    if attachments is None:
        attachments = {"robot.urdf": robot.urdf_text.encode(), "robot.toml": robot.toml_text.encode()}
    with LogWriter(path, manifest={"kind": "test"}, attachments=attachments) as writer:
        for tick, (targets, q) in enumerate(_ticks(robot, samples + 1)):
            stamp = tick * PERIOD_NS
            messages: list[tuple[str, Message]] = [
                (LEFT_TARGET, PoseStamped(stamp, targets[0])),
                (RIGHT_TARGET, PoseStamped(stamp, targets[1])),
                (SAMPLE_JOINTS, JointState(stamp, robot.joints, q)),
            ]
            for topic, message in messages:
                for changed_topic, changed in change(tick, topic, message):
                    writer.write(changed_topic, changed, log_time_ns=stamp)
    return path


def write_plain_episode(path: Path, *, samples: int = 10, measured: bool = False) -> Path:
    """Write an episode whose numbers are products and sums alone: the same bits on every machine.

    Hands as measured come twice as often as ticks, as from a robot with a rate of its own.
    """
    robot = load_robot("asimo")
    attachments = {"robot.urdf": robot.urdf_text.encode(), "robot.toml": robot.toml_text.encode()}
    with LogWriter(path, manifest={"kind": "test"}, attachments=attachments) as writer:
        for tick in range(samples + 1):
            stamp, wave = tick * PERIOD_NS, (tick % 8 - 4) * 0.015625
            writer.write(LEFT_TARGET, PoseStamped(stamp, np.array([0.25, 0.25 + wave, 0.75 - wave])), log_time_ns=stamp)
            writer.write(
                RIGHT_TARGET, PoseStamped(stamp, np.array([0.25, -0.25 + wave, 0.75 + wave])), log_time_ns=stamp
            )
            joints = JointState(stamp, robot.joints, robot.comfort + wave * 0.5)
            writer.write(SAMPLE_JOINTS, joints, log_time_ns=stamp)
            for at_ns in (stamp, stamp + PERIOD_NS // 2) if measured else ():
                left, right = np.array([[0.25, 0.25 + wave * 0.75, 0.75], [0.25, -0.25, 0.75 - wave * 0.75]])
                writer.write(LEFT_MEASURED, PoseStamped(at_ns, left), log_time_ns=at_ns)
                writer.write(RIGHT_MEASURED, PoseStamped(at_ns, right), log_time_ns=at_ns)
    return path


def _ticks(robot: RobotConfig, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    teacher, q, ticks = Teacher(Kinematics(robot)), robot.comfort, []
    for targets in circles(robot).targets[:count]:
        ticks.append((targets, q))
        for _ in range(STEPS_PER_TICK):
            q = teacher.step(q, targets)
    return ticks
