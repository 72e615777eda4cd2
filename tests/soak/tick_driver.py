"""Drives a robot through a controller, tick by tick: python tests/soak/tick_driver.py ENDPOINT HOURS RATE_HZ MODE.

Each time the robot publishes its joints, targets of both hands on a small circle and the joints go out again under the
robot's stamp: a controller answers the targets, the robot follows the answer, and a learner has a tick. In MODE
`lockstep` the robot waits for that answer, and the hours are of its time; in `real-time` it moves on, and they are of
the clock on the wall. Each stamp that the robot left out is counted as missed. Ends with its counts as JSON.
"""

import json
import queue
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import zenoh
from waiting import wait_until

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
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, message_key
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, has_subscribers, open_session

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
def _states(session: zenoh.Session) -> Iterator[queue.Queue[bytes]]:
    """Yield what the robot publishes of its joints."""
    waiting: queue.Queue[bytes] = queue.Queue()

    def take(sample: zenoh.Sample) -> None:
        """Queue a state."""
        waiting.put(sample.payload.to_bytes())

    subscribe = partial(session.declare_subscriber, message_key(DEFAULT_NAMESPACE, JOINT_STATES))
    with on_network_thread(subscribe, take):
        yield waiting


def _first_state(session: zenoh.Session) -> bytes:
    (reply,) = session.get(robot_key(DEFAULT_NAMESPACE, "joints"), timeout=_ANSWER_S)
    assert reply.ok is not None
    return reply.ok.payload.to_bytes()


def _await_subscriber(session: zenoh.Session, topic: str) -> None:
    """Wait until somebody takes a topic: what is put before reaches nobody."""
    with session.declare_publisher(message_key(DEFAULT_NAMESPACE, topic)) as probe:
        wait_until(lambda: has_subscribers(probe))


def drive(session: zenoh.Session, counts: Counts, *, over: Callable[[], bool], period_ns: int, lockstep: bool) -> None:
    """Drive until it is over, which is asked after each tick."""
    centres = load_robot("asimo").input_centre.reshape(2, 3)
    with _states(session) as states, TopicPublisher(session) as publisher:
        for topic in (LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS):
            _await_subscriber(session, topic)
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
            if over():
                return
            data = states.get(timeout=_ANSWER_S)


def main(endpoint: str, hours: float, rate_hz: float, mode: str) -> None:
    config, counts = SessionConfig(connect=(endpoint,)), Counts()
    source = NodeSource("explorer", "soak", state=lambda: mode, counts=lambda: asdict(counts))
    ticks, end_s, lockstep = round(hours * 3600.0 * rate_hz), time.monotonic() + hours * 3600.0, mode == "lockstep"

    def over() -> bool:
        """Whether the hours are over."""
        return counts.ticks >= ticks if lockstep else time.monotonic() >= end_s

    with (
        open_session(config) as session,
        running_node(session, source, config=config, namespace=DEFAULT_NAMESPACE),
    ):
        drive(session, counts, over=over, period_ns=round(1e9 / rate_hz), lockstep=lockstep)
    print(json.dumps(asdict(counts)))


if __name__ == "__main__":
    end_by_exceptions()
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
