"""Drives a robot through a controller, tick by tick: python tests/soak/tick_driver.py ENDPOINT TICKS RATE_HZ MODE.

Each time the robot publishes its joints, targets of both hands on a small circle and the joints go out again under the
robot's stamp: a controller answers the targets, the robot follows the answer, and a learner has a tick. In MODE
`lockstep` the robot waits for that answer; in `real-time` it moves on. Each number and stamp that the robot left out is
counted as missed. Ends with its counts as JSON.
"""

import json
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np
import zenoh
from waiting import matches, wait_until

from pipeline.arrays import Floats
from pipeline.robot.config import load_robot
from pipeline.robot_node.protocol import robot_key
from pipeline.terminal.signals import end_by_exceptions
from recorders.cdr.codec import decode_as
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.wire.callbacks import on_network_thread
from recorders.wire.frames import DEFAULT_NAMESPACE, message_key
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session

_RADIUS_M, _TURN_S = 0.05, 4.0
_ANSWER_S = 600.0  # a command, or an answer, that has not come by then is lost


@dataclass
class Counts:
    """What has been driven so far."""

    ticks: int = 0
    missed: int = 0


def targets(time_ns: int, centres: Floats) -> Floats:
    """Return both hands' targets [m], shape (2, 3): circles in opposite directions."""
    angle = 2.0 * np.pi * (time_ns / 1e9 % _TURN_S) / _TURN_S
    turned = np.array([[0.0, np.cos(angle), np.sin(angle)], [0.0, np.cos(angle), -np.sin(angle)]])
    return centres + _RADIUS_M * turned


@contextmanager
def _states(session: zenoh.Session) -> Iterator[queue.SimpleQueue[bytes]]:
    """Yield what the robot publishes of its joints."""
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    handler = on_network_thread(lambda sample: waiting.put(sample.payload.to_bytes()))
    with session.declare_subscriber(message_key(DEFAULT_NAMESPACE, JOINT_STATES), handler):
        yield waiting


def _first_state(session: zenoh.Session) -> bytes:
    (reply,) = session.get(robot_key(DEFAULT_NAMESPACE, "joints"), timeout=_ANSWER_S)
    return reply.ok.payload.to_bytes()


def drive(session: zenoh.Session, counts: Counts, *, ticks: int, period_ns: int, lockstep: bool) -> None:
    """Drive through so many ticks."""
    centres = load_robot("asimo").input_centre.reshape(2, 3)
    with _states(session) as states, TopicPublisher(session) as publisher:
        for topic in (LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS):
            with session.declare_publisher(message_key(DEFAULT_NAMESPACE, topic)) as probe:
                wait_until(lambda probe=probe: matches(probe))
        data = _first_state(session) if lockstep else states.get(timeout=_ANSWER_S)
        expected_ns = decode_as(JointState, data).stamp_ns
        while True:
            joints = decode_as(JointState, data)
            counts.missed += abs(joints.stamp_ns - expected_ns) // period_ns
            expected_ns = joints.stamp_ns + period_ns
            for topic, hand in zip((LEFT_TARGET, RIGHT_TARGET), targets(joints.stamp_ns, centres), strict=True):
                publisher.publish(topic, PoseStamped(joints.stamp_ns, hand), log_time_ns=joints.stamp_ns)
            publisher.publish(SAMPLE_JOINTS, joints, log_time_ns=joints.stamp_ns)
            counts.ticks += 1
            if counts.ticks == ticks:
                return
            data = states.get(timeout=_ANSWER_S)


def main(endpoint: str, ticks: int, rate_hz: float, mode: str) -> None:
    config, counts = SessionConfig(connect=(endpoint,)), Counts()
    source = NodeSource("explorer", "soak", state=lambda: mode, counts=lambda: asdict(counts))
    with (
        open_session(config) as session,
        running_node(session, source, config=config, namespace=DEFAULT_NAMESPACE),
    ):
        drive(session, counts, ticks=ticks, period_ns=round(1e9 / rate_hz), lockstep=mode == "lockstep")
    print(json.dumps(asdict(counts)))


if __name__ == "__main__":
    end_by_exceptions()
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
