"""The node `serve`: a learned controller as a Zenoh subscriber, with a status for whoever watches and a log."""

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import starmap
from typing import Any

import numpy as np
import zenoh

from pipeline.learner.controller import Controller
from pipeline.robot_node.namespace_checks import RobotCheck, refuse_other_controllers
from pipeline.robot_node.protocol import robot_digest
from pipeline.serving.background_writer import UNNUMBERED, BackgroundWriter
from pipeline.serving.deviation_publisher import DeviationPublisher
from pipeline.serving.input.arrival_clock import ArrivalClock
from pipeline.serving.input.served_inputs import ServedInputs
from pipeline.serving.low_latency import low_latency
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.rejections import Rejection
from pipeline.serving.served_controller import ServedController
from pipeline.serving.topics import CDR, MAX_PAYLOAD, Arrival, TopicReader, sequence_of
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE, type_of
from recorders.nodes.keys import controller_key
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import live_attachment
from recorders.threads import periodic_thread
from recorders.wire.session import SessionConfig, has_subscribers, open_session
from recorders.wire.sim_time import NO_TIME

logger = logging.getLogger(__name__)

_RECENT = 4096  # commands of which the latency is remembered
_RATE_OVER_NS = 2 * 10**9
_HELD_S = 0.05
_LOOK_S = 0.1  # longest single wait for the end
_LOOKS_ALONE = 50  # before it is reported that nobody takes the commands


def serve(
    controller: Controller,
    *,
    session: SessionConfig,
    config: ServeConfig | None = None,
    on_end: Callable[[dict[str, Any], Controller], None] = lambda status, controller: None,
    on_command: Callable[[bytes, tuple[RecordedMessage, ...]], None] | None = None,
) -> None:
    """Serve a controller until the process is stopped.

    A line each is logged when the controller is ready, for the first message refused for each reason, and for a log
    that cannot be written any longer: the robot goes on being commanded. However the serving ends, the log is finished,
    and `on_end` is given the last status and the controller as it is then. `on_command` is given every command that was
    sent, as CDR, and the messages that it answers; it must return at once.

    Raises
    ------
    KeyboardInterrupt, SystemExit
        As raised by Ctrl-C or by a handler of SIGTERM, once all is finished.
    ControllerError, RobotError
        If the controller cannot be served.
    WireError
        If no session can be opened, or another controller serves in the namespace.
    JointError
        If the robot of the namespace has other joints.
    LogError
        If the log cannot be begun; at the end, if it could not be written.
    ConfigError
        If learning diverged.
    """
    config = config or ServeConfig()
    where = f"at {', '.join(session.listen)}" if session.listen else f"through {', '.join(session.connect)}"
    writer = BackgroundWriter(config.log(controller))
    node = None
    try:
        with writer.running():
            node = Node(controller, config, writer, on_command)
            with (
                open_session(session) as opened,
                config.keys.joined(opened),
                low_latency(),
                node.declared(opened, where=where) as robot,
                running_node(
                    opened,
                    node.source(),
                    config=session,
                    namespace=config.namespace,
                    metrics_port=config.metrics_port,
                ),
            ):
                node.wait(robot)
    finally:
        if node is not None and node.serves:
            on_end(node.status(), node.controller())


class Node:
    """A served controller between its subscribers and its publisher.

    Samples are handled on the thread that reads them from the network, which saves a target the way to another thread;
    for the same reason each topic has a subscriber of its own, rather than one that hears everything. Commands are
    dropped where the way out is blocked: a late one is worth nothing, and the reading thread must never wait.

    Parameters
    ----------
    controller : Controller
        Answers the targets.
    config : ServeConfig
        Name and namespace.
    writer : BackgroundWriter
        Writes the log.
    on_command : callable, optional
        Given every command that was sent, as CDR, and the messages that it answers; must return at once.

    Attributes
    ----------
    serves : bool
        Whether it has begun to serve; it stays so at the end.
    """

    def __init__(
        self,
        controller: Controller,
        config: ServeConfig,
        writer: BackgroundWriter,
        on_command: Callable[[bytes, tuple[RecordedMessage, ...]], None] | None = None,
    ) -> None:
        self._on_command = on_command
        self._deviations = DeviationPublisher(writer)
        self._served = served = ServedController(
            controller,
            config=config.serving,
            report=writer.report,
            on_learned=self._record,
            on_deviation=self._deviations.hand_in,
        )
        self._config = config
        self._writer = writer
        self._lock = threading.Lock()  # several connections have several reading threads
        self._held: Arrival | None = None
        self._failure: Exception | None = None
        self._commands = 0
        self._sent_as = config.serving.commands.topic, config.serving.commands.type_name
        self.serves = False
        self._clock = ArrivalClock(use_sim_time=config.use_sim_time)
        self._inputs = ServedInputs(controller, config, served.topics)
        self._first, self._second = (served.pair if self._inputs.plain else None) or ("", "")
        self._readers = {topic: TopicReader(topic) for topic in (*self._inputs.topics, SESSION_PHASE)}
        self._digests = {
            "controller": controller.digest,
            "robot": robot_digest(controller.robot_toml, controller.robot_urdf),
        }
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)  # (arrival, latency) [ns]

    @contextmanager
    def declared(self, session: zenoh.Session, *, where: str) -> Iterator[RobotCheck]:
        """Declare publisher, subscribers, status and, last, the liveliness token: who sees it may send targets.

        Before that the line is logged that it serves.

        Parameters
        ----------
        session : zenoh.Session
            An open session.
        where : str
            Where it listens, or through which endpoints it connects, in words.

        Yields
        ------
        RobotCheck
        Looks at robots that come later.

        Raises
        ------
        WireError
            If another controller serves in the namespace.
        JointError
            If the robot that is there has other joints.
        """
        name, keys, commands = self._config.name, self._config.keys, self._config.serving.commands
        namespace = keys.namespace
        refuse_other_controllers(session, name, keys=keys, allow_multiple=self._config.allow_multiple)
        robot = RobotCheck(session, self._served.joints, namespace=namespace)
        with ExitStack() as stack:
            stack.enter_context(robot.watching())
            robot.check()
            self._publisher = stack.enter_context(
                keys.publishing(
                    session,
                    commands.topic,
                    commands.type_name,
                    encoding=f"{CDR}{commands.type_name}",
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.REAL_TIME,
                )
            )
            stack.enter_context(self._deviations.declared(session, keys))
            stack.enter_context(self._clock.running(session, keys))
            for topic, reader in self._readers.items():
                kind = self._inputs.types.get(topic) or type_of(topic)
                stack.enter_context(keys.subscribing(session, topic, kind, self._handler(reader), at_once=True))
            status_key = controller_key(namespace, name, "status")
            stack.enter_context(session.declare_queryable(status_key, self._answer_query))
            self.serves = True  # before anybody can know, and end it
            logger.info(f"{name} serves {keys.described(commands.topic, commands.type_name)} {where}")
            stack.enter_context(session.liveliness().declare_token(controller_key(namespace, name, "alive")))
            stack.enter_context(periodic_thread(self._look_after_held, name="held", every_s=_HELD_S))
            yield robot

    def wait(self, robot: RobotCheck) -> None:
        """Return never; raises what serving failed of, or what a signal's handler raises.

        Parameters
        ----------
        robot : RobotCheck
            Looks at robots that come meanwhile.
        """
        alone = 0
        while self._failure is None:
            time.sleep(_LOOK_S)  # a signal that comes just before a wait begins does not end it
            robot.check_newcomer()
            alone = alone + 1 if self._commands and not has_subscribers(self._publisher) else 0
            if alone == _LOOKS_ALONE:
                what = self._config.keys.described(*self._sent_as)
                logger.warning(f"nobody subscribes to {what}: commands move nothing")
        raise self._failure

    def source(self) -> NodeSource:
        """Return the status of this node for whoever watches; none of it waits for a command, nor delays one."""
        return NodeSource(
            "controller",
            self._config.name,
            state=lambda: self._served.state,
            counts=self._counts,
            latency_us=lambda: _percentiles(self._latencies()),
            digests=lambda: self._digests,
        )

    def _counts(self) -> dict[str, int]:
        return {"commands": self._commands, "recorded": self._writer.written} | self._served.counts()

    def _latencies(self) -> list[int]:
        with self._lock:
            recent = list(self._recent)
        return [latency for _, latency in recent]

    def status(self) -> dict[str, Any]:
        """Return the status of the controller, and counts, rate and latencies of this node, as JSON has it.

        `latency_us` is the time from the arrival of the message that completes a tick to the end of the command's put,
        over the last commands; `rate_hz` counts the commands of the last two seconds.
        """
        with self._lock:
            self._take_held()
            status = self._served.status_later()  # worked out below: no command waits for that
            recent, commands, now = list(self._recent), self._commands, time.perf_counter_ns()
        return {
            "name": self._config.name,
            "topics": list(self._readers),
            "joints": list(self._served.joints),
            **status(),
            **self._inputs.counts,
            "commands": commands,
            "rate_hz": sum(now - arrival <= _RATE_OVER_NS for arrival, _ in recent) * 1e9 / _RATE_OVER_NS,
            "latency_us": _percentiles([latency for _, latency in recent]) | {"commands": len(recent)},
            "recording": self._writer.records,
            "recorded": self._writer.written,
        }

    def controller(self) -> Controller:
        """Return the controller as it is now."""
        with self._lock:
            self._take_held()
            return self._served.controller()

    def _handler(self, reader: TopicReader) -> Callable[[zenoh.Sample], None]:
        """Return what takes the samples of a topic.

        The first message of a tick leads to no command, and the one that does mostly is close behind it: the first is
        held unread, so that both are read at once.
        """
        lock, served, now_ns = self._lock, self._served, self._clock.now_ns
        holds = len(served.topics) > 1 and self._inputs.plain

        def on_sample(sample: zenoh.Sample) -> None:
            arrival_ns = time.perf_counter_ns()
            arrived = reader, sample, now_ns()
            with lock:
                if arrived[2] < 0:
                    served.reject(Rejection.NO_TIME, f"{reader.topic}: {NO_TIME}")
                elif holds and self._held is None and served.between_ticks:
                    self._held = arrived
                else:
                    self._take(arrived, arrival_ns)

        return on_sample

    def _take(self, arrived: Arrival | None, arrival_ns: int) -> None:
        """Take what is held, and what has arrived after it."""
        held, self._held = self._held, None
        if self._failure is not None:
            return
        try:
            if held is None or arrived is None or not self._answer_pair(held, arrived, arrival_ns):
                for waiting in filter(None, (held, arrived)):
                    self._answer(waiting, arrival_ns)
            self._served.settle()
        except Exception as error:
            self._failure = error  # which ends the node

    def _answer_pair(self, held: Arrival, arrived: Arrival, arrival_ns: int) -> bool:
        """Answer two poses that ask for no more than a command; False if they are none, and nothing is done."""
        pair = (arrived, held) if held[0].topic == self._second else (held, arrived)
        (left_reader, left, _), (right_reader, right, _) = pair
        if left_reader.topic != self._first or right_reader.topic != self._second:
            return False
        answer = self._served.answer_pair(left_reader.pose(left), right_reader.pose(right))
        if answer is None:
            return False
        stamp_ns, command = answer
        self._publish(stamp_ns, command, arrival_ns)
        if self._writer.records or self._on_command is not None:  # only now is it worth to look at them again
            self._pass_on(command, tuple(filter(None, starmap(self._read, pair))))
        return True

    def _answer(self, arrived: Arrival, arrival_ns: int) -> None:
        record = self._read(*arrived)
        for taken in () if record is None else self._inputs.taken(record):
            if (command := self._served.take(taken)) is not None:
                self._publish(command.stamp_ns, command.data, arrival_ns)
                self._pass_on(command.data, command.answered)

    def _take_held(self) -> None:
        """Take what is held although nothing follows it."""
        self._take(None, time.perf_counter_ns())

    def _look_after_held(self) -> None:
        """See that nothing is held for long: it may be something to reject."""
        with self._lock:
            self._take_held()

    def _publish(self, stamp_ns: int, command: bytes, arrival_ns: int) -> None:
        """Send a command."""
        self._publisher.put(command, attachment=live_attachment(self._commands, stamp_ns, self._deviations.identity))
        self._recent.append((arrival_ns, time.perf_counter_ns() - arrival_ns))
        self._commands += 1

    def _record(self, messages: tuple[RecordedMessage, ...]) -> None:
        """Record the messages of a tick that was learned."""
        if self._writer.records:
            for message in messages:
                self._writer.write(message)

    def _pass_on(self, command: bytes, answered: tuple[RecordedMessage, ...]) -> None:
        """Pass a command on to whoever records and watches."""
        if self._writer.records:
            sent = RecordedMessage(*self._sent_as, command, self._commands - 1, self._clock.now_ns())
            self._record((*answered, sent))
        if self._on_command is not None:
            self._on_command(self._served.joint_state(), answered)

    def _read(self, reader: TopicReader, sample: zenoh.Sample, time_ns: int) -> RecordedMessage | None:
        """Return the message of a sample, as it goes into a log too; None if there is none."""
        if sample.kind != zenoh.SampleKind.PUT:
            return None  # a deleted key is no target
        if (size := len(sample.payload)) > MAX_PAYLOAD:
            self._served.reject(Rejection.TOO_LARGE, f"{reader.topic}: found {size} bytes")
            return None
        sequence = sequence_of(self._config.keys, reader.topic, sample) if self._writer.records else UNNUMBERED
        return RecordedMessage(
            reader.topic, reader.type_name(sample.encoding), sample.payload.to_bytes(), sequence, time_ns
        )

    def _answer_query(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, json.dumps(self.status()), encoding="application/json")


def _percentiles(latencies_ns: list[int]) -> dict[str, float | None]:
    values = np.percentile(latencies_ns, [50, 90, 99, 100]).tolist() if latencies_ns else [None] * 4
    named = zip(("p50", "p90", "p99", "max"), values, strict=True)
    return {name: None if value is None else value / 1e3 for name, value in named}
