"""Messages of a driven robot: its state at its own rate, and those of a tick."""

from collections.abc import Iterator
from typing import TypeAlias

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPoseSource, RobotBackend
from pipeline.robot.coordinates import POSITION_SIZE
from recorders.messages import topics
from recorders.messages.message_types import Clock, JointState, Message, PoseStamped, TFMessage, TransformStamped

TopicMessage: TypeAlias = tuple[str, Message]  # topic, message


def state_messages(backend: LinkPoseSource) -> Iterator[TopicMessage]:
    """Yield clock, joints and link poses of a robot at this instant."""
    yield topics.CLOCK, Clock(backend.time_ns)
    yield topics.JOINT_STATES, joints_message(backend)
    transforms = [
        TransformStamped(backend.time_ns, pose.parent, pose.child, pose.translation, pose.rotation)
        for pose in backend.link_poses()
    ]
    yield topics.TF, TFMessage(tuple(transforms))


def hand_messages(backend: RobotBackend) -> Iterator[TopicMessage]:
    """Yield the hands at this instant."""
    for name, row in zip(backend.robot.hand_names, backend.hands(), strict=True):
        yield topics.hand_measured(name), hand_message(backend.time_ns, row)


def hand_message(stamp_ns: int, row: Floats) -> PoseStamped:
    """Return the message of a hand's row: its position [m], and its orientation x, y, z, w if that counts."""
    if len(row) == POSITION_SIZE:
        return PoseStamped(stamp_ns, row)
    return PoseStamped(stamp_ns, row[:POSITION_SIZE], orientation=row[POSITION_SIZE:])


def tick_messages(backend: RobotBackend, targets: Floats) -> Iterator[TopicMessage]:
    """Yield a tick, all under one stamp: new `targets` of all hands by row, and the joints measured at this instant."""
    for name, target in zip(backend.robot.hand_names, targets, strict=True):
        yield topics.hand_target(name), hand_message(backend.time_ns, target)
    yield topics.SAMPLE_JOINTS, joints_message(backend)


def command_message(backend: RobotBackend, q_command: Floats) -> TopicMessage:
    """Return the posture (n,) commanded at this instant."""
    return topics.JOINT_COMMANDS, JointState(backend.time_ns, backend.robot.joints, q_command)


def joints_message(backend: RobotBackend) -> JointState:
    """Return positions and velocities of the joints at this instant."""
    return JointState(backend.time_ns, backend.robot.joints, backend.positions, velocity=backend.velocities)
