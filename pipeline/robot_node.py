"""The simulated robot as a Zenoh node: joint commands in; joints, hands, link poses and clock out."""

import queue
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, NoReturn, Self, TypeAlias

import zenoh

from pipeline.backend import VisibleRobot
from pipeline.follower import Follower, FollowerConfig
from pipeline.robot import RobotConfig
from pipeline.robot_wire import MAX_COMMAND, config_key, robot_key
from pipeline.simulation import Simulation
from pipeline.telemetry import joints_message
from recorders.cdr import encode
from recorders.errors import MessageError, ReenactError, WireError
from recorders.messages import Message, String
from recorders.topics import JOINT_COMMANDS, ROBOT_DESCRIPTION
from recorders.wire.frames import DEFAULT_NAMESPACE, NO_RUN, check_namespace, message_key, unpack
from recorders.wire.producer import Producer
from recorders.wire.session import SessionConfig, open_session

_MAX_WAITING = 1024
"""Commands and questions beyond this many are dropped: a flood must not fill the memory."""

_ALIVE_WAIT_S = 1.0  # a robot that is there already answers within milliseconds


class _Command(NamedTuple):
    """A command from the topic; None if it is too large to be one."""

    data: bytes | None
    streamed: bool  # part of a stream, whose sender may send it again


class _Question(NamedTuple):
    """A query for `command`, `reset`, `joints` or `status`."""

    verb: str
    query: zenoh.Query


_Event: TypeAlias = _Command | _Question


class RobotNode:
    """Wires a robot to Zenoh; `pipeline.robot_wire` says what travels.

    Zenoh calls back on threads of its own, which only queue. The robot moves on the caller's thread, in `run`.

    Parameters
    ----------
    backend : VisibleRobot
        The robot.
    session : zenoh.Session
        An open session.
    namespace : str
        First part of every key.
    config : FollowerConfig
        Rate and mode.
    say : callable
        Told, in one line, of a command that is refused; not again while the reason stays the same.

    Raises
    ------
    WireError
        On entering, if another robot stands in the namespace.
    """

    def __init__(
        self,
        backend: VisibleRobot,
        session: zenoh.Session,
        *,
        namespace: str = DEFAULT_NAMESPACE,
        config: FollowerConfig | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        check_namespace(namespace)
        self._backend = backend
        self._session = session
        self._namespace = namespace
        self._config = config or FollowerConfig()
        self._say = say
        self._inbox: queue.SimpleQueue[_Event] = queue.SimpleQueue()
        self._unanswered: list[zenoh.Query] = []  # commands of this period, in real time
        self._last_refusal = ""
        self._producer = Producer(session, namespace=namespace)
        self._robot = Follower(
            backend,
            config=self._config,
            publish=self._publish,
        )
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Say the description and be ready for commands; the token comes last, as it promises all the rest."""
        self._refuse_company()
        with ExitStack() as stack:
            stack.enter_context(self._producer)
            self._describe(stack)
            for verb in ("command", "reset", "joints", "status"):
                answering = zenoh.handlers.Callback(self._on_query(verb), indirect=False)
                stack.enter_context(self._session.declare_queryable(robot_key(self._namespace, verb), answering))
            listening = zenoh.handlers.Callback(self._on_sample, indirect=False)
            topic_key = message_key(self._namespace, JOINT_COMMANDS)
            stack.enter_context(self._session.declare_subscriber(topic_key, listening))
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
        while not self._config.real_time:
            self._handle(self._inbox.get())
        due_s = time.monotonic()
        while True:
            due_s += self._config.period_ns / 1e9
            late_s = max(0.0, time.monotonic() - due_s)
            due_s += late_s  # what is lost is lost: the robot never hurries
            self._robot.slipped_s += late_s
            self._handle_until(due_s)
            self._robot.hold()
            while self._unanswered:
                self._answer(self._unanswered.pop())

    def _refuse_company(self) -> None:
        for reply in self._session.liveliness().get(robot_key(self._namespace, "alive"), timeout=_ALIVE_WAIT_S):
            if reply.ok is not None:
                raise WireError(
                    f"a robot stands in namespace '{self._namespace}' already: end that one, or choose with --namespace"
                )

    def _describe(self, stack: ExitStack) -> None:
        """Publish the URDF once, and answer whoever asks for it or for the TOML later."""
        robot = self._backend.robot
        topic_key = message_key(self._namespace, ROBOT_DESCRIPTION)
        for key, text in ((topic_key, robot.urdf_text), (config_key(self._namespace), robot.toml_text)):
            answering = zenoh.handlers.Callback(_replier(encode(String(text))), indirect=False)
            stack.enter_context(self._session.declare_queryable(key, answering))
        self._producer.publish(ROBOT_DESCRIPTION, String(robot.urdf_text), log_time_ns=0)

    def _handle_until(self, due_s: float) -> None:
        """Handle what comes before a time, and in any case some of what is waiting."""
        for _ in range(_MAX_WAITING):
            try:
                event = self._inbox.get(timeout=max(0.0, due_s - time.monotonic()))
            except queue.Empty:
                return
            self._handle(event)

    def _handle(self, event: _Event) -> None:
        query = event.query if isinstance(event, _Question) else None
        try:
            if isinstance(event, _Question):
                self._handle_question(*event)
            else:
                past_ns = self._backend.time_ns if event.streamed else 0
                self._robot.follow(_whole(event.data), repeats_ns=past_ns)
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
        data = _whole(None if query.payload is None else _small(query.payload))
        if verb == "reset":
            self._robot.reset(data)
        else:
            self._robot.follow(data, repeats_ns=self._config.period_ns)
            if self._config.real_time:
                self._unanswered.append(query)
                return
        self._answer(query)

    def _publish(self, topic: str, message: Message) -> None:
        self._producer.publish(topic, message, log_time_ns=self._backend.time_ns)

    def _refuse(self, reason: str) -> None:
        self._robot.refused += 1
        if reason != self._last_refusal:
            self._last_refusal = reason
            self._say(f"refused a command: {reason}")

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, encode(joints_message(self._backend)))

    # From here on: Zenoh's threads.

    def _on_sample(self, sample: zenoh.Sample) -> None:
        self._queue(_Command(_small(sample.payload), _is_streamed(sample)))

    def _on_query(self, verb: str) -> Callable[[zenoh.Query], None]:
        return lambda query: self._queue(_Question(verb, query))

    def _queue(self, event: _Event) -> None:
        if self._inbox.qsize() < _MAX_WAITING:
            self._inbox.put(event)


def run_robot(
    robot: RobotConfig,
    *,
    session: SessionConfig,
    namespace: str = DEFAULT_NAMESPACE,
    config: FollowerConfig | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> NoReturn:
    """Simulate a robot and let it follow commands over Zenoh, until an exception ends it, such as a signal's.

    Raises
    ------
    RobotError
        If the robot cannot be simulated.
    WireError
        If no session can be opened, or another robot stands in the namespace.
    """
    backend = Simulation(robot)
    with (
        open_session(session) as opened,
        RobotNode(backend, opened, namespace=namespace, config=config, say=say) as node,
    ):
        say(f"{robot.name} waits for commands at {', '.join(session.listen or session.connect)}")
        node.run()


def _small(payload: zenoh.ZBytes) -> bytes | None:
    return payload.to_bytes() if len(payload) <= MAX_COMMAND else None


def _whole(data: bytes | None) -> bytes:
    if data is None:
        raise MessageError(f"expected a JointState of at most {MAX_COMMAND} bytes, found none or a larger message")
    return data


def _is_streamed(sample: zenoh.Sample) -> bool:
    """Whether a sample is part of a stream; a live message is not, and one of a foreign publisher has no attachment."""
    if sample.attachment is None:
        return False
    try:
        return unpack(JOINT_COMMANDS, b"", sample.attachment.to_bytes()).run != NO_RUN
    except MessageError:
        return False


def _replier(payload: bytes) -> Callable[[zenoh.Query], None]:
    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, payload)

    return reply
