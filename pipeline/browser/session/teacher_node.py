"""The teacher as a Zenoh node: hand targets in, joint commands out, as a served controller; to be run as a module."""

import json
import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.browser.session.keys import controller_topic
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.robot_node.client import RemoteRobot
from pipeline.serving.inputs import JointsReader, TargetReader
from pipeline.serving.rejections import Rejections
from pipeline.teacher.teacher import Teacher
from pipeline.terminal.log_lines import logging_to_terminal
from pipeline.terminal.signals import until_stopped
from recorders.errors import ReenactError
from recorders.messages.message_types import JointState
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES, hand_target, type_of
from recorders.nodes.keys import controller_key
from recorders.ticks.joiner import JointMap
from recorders.ticks.stamp_joiner import RejectionError
from recorders.wire.keys.namespace import message_key
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import Sample, Session, SessionConfig, open_session

logger = logging.getLogger(__name__)

NAME = "teacher"
"""Name of the node among the controllers."""

_PAUSE_NS = 200_000_000  # after so long without targets it goes on from the joints as they are, not from its own
_MOST_STEPS = 20  # of one command
_MAX_PAYLOAD = 1 << 16
_WAIT_S = 60.0
_LOOK_S = 0.1


class TeacherCommands:
    """Commands of the teacher, which answers targets with where the joints are to be when the next ones come.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._teacher = Teacher(Kinematics(robot))
        self._q = self._measured = robot.comfort
        self._last_ns = -_PAUSE_NS

    def measure(self, q: Floats) -> None:
        """Take joints as measured (n,) [rad or m]."""
        self._measured = q

    def answer(self, stamp_ns: int, inputs: Floats) -> Floats:
        """Return the posture (n,) to command for targets (inputs,) under a stamp [ns]."""
        passed_ns = stamp_ns - self._last_ns
        if not 0 < passed_ns < _PAUSE_NS:
            self._q, passed_ns = self._measured, 0
        self._last_ns = stamp_ns
        steps = min(max(1, round(passed_ns / self._teacher.period_ns)), _MOST_STEPS)
        rows = to_rows(self._robot, inputs)
        for _ in range(steps):
            self._q = self._teacher.step(self._q, rows)
        return self._q


class TeacherNode:
    """Node of a teacher in a session.

    Parameters
    ----------
    session : Session
        An open session.
    robot : RobotConfig
        The robot.
    namespace : str
        First part of every key.
    """

    def __init__(self, session: Session, robot: RobotConfig, *, namespace: str) -> None:
        self._session, self._robot, self._namespace = session, robot, namespace
        check = range_check(robot)
        self._readers = [
            TargetReader(hand.centre, check, float("inf"), pose=check.poses.get(hand_target(hand.name)))
            for hand in robot.hands
        ]
        self._joints, self._map = JointsReader(check), JointMap(robot.joints)
        self._commands = TeacherCommands(robot)
        self._rejections = Rejections(logger.warning)
        self._waiting: dict[int, tuple[int, tuple[float, ...]]] = {}
        self._lock = threading.Lock()
        self._accepted = 0
        self.failure: Exception | None = None

    @contextmanager
    def declared(self) -> Iterator[None]:
        """Answer targets while the block runs."""
        key, names = self._namespace, self._robot.hand_names
        with TopicPublisher(self._session, keys=NamespaceKeys(key)) as self._publisher, ExitStack() as stack:
            for place, hand in enumerate(names):
                topic = controller_topic(NAME, hand)
                stack.enter_context(
                    self._session.declare_subscriber(message_key(key, topic), partial(self._take, place))
                )
            stack.enter_context(self._session.declare_subscriber(message_key(key, JOINT_STATES), self._take_state))
            stack.enter_context(self._session.declare_queryable(controller_key(key, NAME, "status"), self._reply))
            stack.enter_context(self._session.liveliness().declare_token(controller_key(key, NAME, "alive")))
            yield

    def _take(self, place: int, sample: Sample) -> None:
        """Take the target of a hand: on a thread of Zenoh's."""
        record = _record(hand_target(self._robot.hand_names[place]), sample)
        with self._lock:
            try:
                self._waiting[place] = self._readers[place].read(record)
                stamps = {stamp_ns for stamp_ns, _ in self._waiting.values()}
                if len(self._waiting) == len(self._readers) and len(stamps) == 1:
                    self._answer(stamps.pop())
            except RejectionError as error:
                self._rejections.add(error.kind, str(error))
            except Exception as error:
                self.failure = error  # which ends the node

    def _answer(self, stamp_ns: int) -> None:
        inputs = np.concatenate([self._waiting[place][1] for place in range(len(self._readers))])
        command = self._commands.answer(stamp_ns, inputs)
        self._publisher.publish(JOINT_COMMANDS, JointState(stamp_ns, self._robot.joints, command), log_time_ns=stamp_ns)
        self._waiting.clear()
        self._accepted += 1

    def _take_state(self, sample: Sample) -> None:
        with self._lock:
            try:
                _, joints = self._joints.read(_record(JOINT_STATES, sample))
                self._commands.measure(self._map.positions(joints))
            except RejectionError as error:
                self._rejections.add(error.kind, str(error))

    def _reply(self, query: Any) -> None:
        with self._lock:
            status = {"accepted": self._accepted, "refused": self._rejections.counts()}
            status["last_refusal"] = self._rejections.last
        with query:
            query.reply(query.key_expr, json.dumps(status), encoding="application/json")


def _record(topic: str, sample: Sample) -> RecordedMessage:
    data = sample.payload.to_bytes() if len(sample.payload) <= _MAX_PAYLOAD else b""
    return RecordedMessage(topic, type_of(topic), data, 0, 0)


def run(endpoint: str, namespace: str) -> None:
    """Serve the teacher of the robot in a namespace until a signal ends it.

    Raises
    ------
    WireError, RobotError
        If no robot answers, or it is not usable.
    """
    with open_session(SessionConfig(connect=(endpoint,), wait_s=_WAIT_S)) as session, until_stopped() as stopped:
        robot = RemoteRobot(session, namespace=namespace, wait_s=_WAIT_S).robot
        node = TeacherNode(session, robot, namespace=namespace)
        with node.declared():
            ended = threading.Event()
            while not stopped() and node.failure is None:
                ended.wait(_LOOK_S)
        if node.failure is not None:
            raise node.failure


def main() -> None:
    """Run the node for an endpoint and a namespace, the two arguments."""
    try:
        with logging_to_terminal():
            run(*sys.argv[1:])
    except ReenactError as error:
        sys.stderr.write(f"reenact: {error}\n")
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
