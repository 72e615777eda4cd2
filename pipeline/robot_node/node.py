"""The simulated robot as a Zenoh node: joint commands in; joints, hands, link poses and clock out."""

import logging
import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from types import TracebackType
from typing import NamedTuple, NoReturn, Self, TypeAlias

import zenoh

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPoseSource
from pipeline.robot.config import RobotConfig
from pipeline.robot.telemetry import hand_messages, joints_message
from pipeline.robot_node.follower import Follower, FollowerConfig
from pipeline.robot_node.protocol import (
    MAX_COMMAND,
    pack_messages,
    robot_digest,
    robot_key,
    unpack_messages,
)
from pipeline.simulation.joint_offset import OffsetRobot
from pipeline.simulation.simulation import Simulation
from recorders.cdr.codec import encode
from recorders.errors import MessageError, ReenactError, WireError
from recorders.messages.message_types import JointState, Message, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_COMMANDS, ROBOT_CONFIG, ROBOT_DESCRIPTION
from recorders.nodes.keys import node_name
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import NO_RUN, Frame, FrameType, pack
from recorders.rmw_zenoh.qos import LATCHED
from recorders.wire.bounded_queue import ITEM_BYTES, BoundedQueue
from recorders.wire.callbacks import on_network_thread
from recorders.wire.keys.namespace import message_key
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session

logger = logging.getLogger(__name__)

MAX_WAITING = 1024
"""Commands and questions beyond this many are dropped: a flood must not fill the memory."""

_ALIVE_WAIT_S = 5.0  # who is there is known at once; this machine may be very busy
_QUIET_S = 1.0  # after so much silence a flood is over, and the next one is worth a line again
_SLIP_S = 0.1  # from here on it is logged that the robot's time has slipped, and again whenever that has doubled


class _Command(NamedTuple):
    """A command from the topic; None if it is too large to be one."""

    data: bytes | None


class _Question(NamedTuple):
    """A query for `command`, `reset`, `joints` or `status`."""

    verb: str
    query: zenoh.Query


_Event: TypeAlias = _Command | _Question


class RobotNode:
    """Connects a robot to Zenoh; `pipeline.robot_node.protocol` defines the messages.

    Zenoh calls back on threads of its own, which only queue. The robot moves on the caller's thread, in `run`.
    A command that is refused is logged, and not again while the reason, numbers aside, stays the same; a flood when it
    begins, and time that slips.

    Parameters
    ----------
    backend : LinkPoseSource
        The robot.
    session : zenoh.Session
        An open session.
    keys : TopicKeys, optional
        Keys of the topics, and the namespace; those of the default namespace if left out.
    config : FollowerConfig
        Rate and mode.

    Raises
    ------
    WireError
        On entering, if another robot stands in the namespace.
    """

    def __init__(
        self,
        backend: LinkPoseSource,
        session: zenoh.Session,
        *,
        keys: TopicKeys | None = None,
        config: FollowerConfig | None = None,
    ) -> None:
        self._backend = backend
        self._session = session
        self._keys = keys or NamespaceKeys()
        self._namespace = self._keys.namespace
        self._config = config or FollowerConfig()
        self._inbox: BoundedQueue[_Event] = BoundedQueue(limit=MAX_WAITING * ITEM_BYTES)
        self._unanswered: list[zenoh.Query] = []  # commands of this period, in real time
        self._last_refusal = ""
        self._flooded = False
        self._slip_to_report_s = _SLIP_S
        self._producer = TopicPublisher(session, keys=self._keys)
        self._robot = Follower(backend, config=self._config, publish=self._publish)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Publish the description and subscribe to commands; the token comes last, as it promises all the rest."""
        self._refuse_other_controllers()
        with ExitStack() as stack:
            stack.enter_context(self._producer)
            self._describe(stack)
            for verb in ("command", "reset", "joints", "hands", "status"):
                declare = partial(self._session.declare_queryable, robot_key(self._namespace, verb))
                stack.enter_context(on_network_thread(declare, self._on_query(verb)))
            take, kind = self._on_sample, JointState.TYPE
            subscribing = self._keys.subscribing(self._session, JOINT_COMMANDS, kind, take, at_once=True)
            stack.enter_context(subscribing)
            stack.enter_context(self._session.liveliness().declare_token(robot_key(self._namespace, "alive")))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Undeclare everything; the session stays open."""
        self._stack.close()

    def run(self) -> NoReturn:
        """Stand in the comfort posture, and follow commands until an exception ends it, such as a signal's."""
        self._robot.stand(self._backend.robot.comfort)
        if self._config.real_time:
            self._run_with_the_clock()
        while True:
            self._handle_next(timeout_s=_QUIET_S)

    def source(self) -> NodeSource:
        """Return the status of this node."""
        robot = self._backend.robot
        return NodeSource(
            "robot",
            node_name(robot.name),
            state=lambda: "real time" if self._config.real_time else "lockstep",
            counts=self._counts,
            digests=lambda: {"robot": robot_digest(robot.toml_text, robot.urdf_text)},
        )

    def _counts(self) -> dict[str, int]:
        status = self._robot.status
        return {
            "commands": status.commands,
            "refused": status.refused,
            "messages": self._producer.published,
            "slipped_ms": round(status.slipped_s * 1e3),
        }

    def _run_with_the_clock(self) -> NoReturn:
        period_s = self._config.period_ns / 1e9
        due_s = time.monotonic()
        while True:
            due_s = self._slip(due_s + period_s)
            self._handle_until(due_s)
            self._robot.hold()
            while self._unanswered:
                self._answer(self._unanswered.pop())

    def _slip(self, due_s: float) -> float:
        """Return when the period that begins is over: not before now. What is lost is lost: the robot never hurries."""
        late_s = max(0.0, time.monotonic() - due_s)
        self._robot.slipped_s += late_s
        if self._robot.slipped_s >= self._slip_to_report_s:
            self._slip_to_report_s = 2 * self._robot.slipped_s
            logger.warning(
                f"time slips: {self._robot.slipped_s:.1f} s behind the clock on the wall so far; this machine is too "
                "slow or too busy for real time"
            )
        return due_s + late_s

    def _refuse_other_controllers(self) -> None:
        for reply in self._session.liveliness().get(robot_key(self._namespace, "alive"), timeout=_ALIVE_WAIT_S):
            if reply.ok is not None:
                raise WireError(
                    f"a robot stands in namespace '{self._namespace}' already: end that one, or choose with --namespace"
                )

    def _describe(self, stack: ExitStack) -> None:
        """Answer queries for URDF and TOML, and publish both for subscribers, late ones as well."""
        robot = self._backend.robot
        for topic, text in ((ROBOT_DESCRIPTION, robot.urdf_text), (ROBOT_CONFIG, robot.toml_text)):
            key, data = message_key(self._namespace, topic), encode(String(text))
            stack.enter_context(on_network_thread(partial(self._session.declare_queryable, key), _replier(data)))
            publisher = self._keys.publishing(
                self._session,
                topic,
                String.TYPE,
                qos=LATCHED,
                encoding=f"application/cdr;{String.TYPE}",
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            frame = Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (RecordedMessage(topic, String.TYPE, data, 0, 0),))
            payload, attachment = pack(frame)
            stack.enter_context(publisher).put(payload, attachment=attachment)

    def _handle_until(self, due_s: float) -> None:
        """Handle what comes before a time, and in any case some of what is waiting."""
        for _ in range(MAX_WAITING):
            if not self._handle_next(timeout_s=max(0.0, due_s - time.monotonic())):
                return

    def _handle_next(self, *, timeout_s: float) -> bool:
        """Handle what has waited longest; False if nothing comes."""
        event = self._inbox.get(timeout_s)
        if event is not None:
            self._handle(event)
        self._note_flood(self._inbox.take_dropped(), over=event is None)
        return event is not None

    def _note_flood(self, dropped: int, *, over: bool) -> None:
        self._robot.refused += dropped
        if dropped and not self._flooded:
            logger.warning(f"a flood: dropped commands and questions, as more than {MAX_WAITING} of them wait")
        self._flooded = dropped > 0 or (self._flooded and not over)

    def _handle(self, event: _Event) -> None:
        query = event.query if isinstance(event, _Question) else None
        try:
            if isinstance(event, _Question):
                self._handle_question(*event)
            else:
                self._robot.follow(_whole(event.data))
        except ReenactError as error:
            self._refuse(str(error))
            if query is not None:
                with query:
                    query.reply_err(str(error), encoding=zenoh.Encoding.TEXT_PLAIN)

    def _handle_question(self, verb: str, query: zenoh.Query) -> None:
        if verb == "status":
            with query:
                query.reply(query.key_expr, self._robot.status.to_json(), encoding=zenoh.Encoding.APPLICATION_JSON)
            return
        if verb == "joints":
            self._answer(query)
            return
        if verb == "hands":
            with query:
                query.reply(query.key_expr, pack_messages(encode(pose) for _, pose in hand_messages(self._backend)))
            return
        data = _whole(None if query.payload is None else _small(query.payload))
        if verb == "reset":
            self._robot.reset(data)
        else:
            for command in unpack_messages(data):
                self._robot.follow(command)
            if self._config.real_time:
                self._unanswered.append(query)
                return
        self._answer(query)

    def _publish(self, topic: str, message: Message) -> None:
        self._producer.publish(topic, message, log_time_ns=self._backend.time_ns)

    def _refuse(self, reason: str) -> None:
        self._robot.refused += 1
        kind = re.sub(r"[\d.]+", "", reason)
        if kind != self._last_refusal:
            self._last_refusal = kind
            logger.warning(f"refused a command: {reason}")

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, encode(joints_message(self._backend)))

    # From here on: Zenoh's threads.

    def _on_sample(self, sample: zenoh.Sample) -> None:
        self._inbox.put(_Command(_small(sample.payload)), 0)

    def _on_query(self, verb: str) -> Callable[[zenoh.Query], None]:
        def on_query(query: zenoh.Query) -> None:
            """Queue a query."""
            self._inbox.put(_Question(verb, query), 0)

        return on_query


def run_robot(
    robot: RobotConfig,
    *,
    session: SessionConfig,
    keys: TopicKeys | None = None,
    config: FollowerConfig | None = None,
    metrics_port: int | None = None,
    joint_offsets: Floats | None = None,
) -> NoReturn:
    """Simulate a robot and let it follow commands over Zenoh, until an exception ends it, such as a signal's.

    With a `metrics_port`, its status is there for Prometheus too, on 127.0.0.1. With `joint_offsets` [rad or m], shape
    (n,), its joints are wrongly zeroed, as `pipeline.simulation.joint_offset` has it.

    Raises
    ------
    RobotError
        If the robot cannot be simulated.
    WireError
        If no session can be opened, or another robot stands in the namespace.
    """
    simulation = Simulation(robot)
    keys = keys or NamespaceKeys()
    backend = simulation if joint_offsets is None else OffsetRobot(simulation, joint_offsets)
    with (
        open_session(session) as opened,
        keys.joined(opened),
        RobotNode(backend, opened, keys=keys, config=config) as node,
        running_node(opened, node.source(), config=session, namespace=keys.namespace, metrics_port=metrics_port),
    ):
        logger.info(f"{robot.name} waits for commands at {', '.join(session.listen or session.connect)}")
        node.run()


def _small(payload: zenoh.ZBytes) -> bytes | None:
    return payload.to_bytes() if len(payload) <= MAX_COMMAND else None


def _whole(data: bytes | None) -> bytes:
    if data is None:
        raise MessageError(f"expected commands of at most {MAX_COMMAND} bytes, found none or a larger message")
    return data


def _replier(payload: bytes) -> Callable[[zenoh.Query], None]:
    def reply(query: zenoh.Query) -> None:
        """Reply to a query."""
        with query:
            query.reply(query.key_expr, payload)

    return reply
