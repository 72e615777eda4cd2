"""The node `serve`: a learned controller as a Zenoh subscriber, with a status for whoever watches and a log."""

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from pipeline.controller import Controller
from pipeline.robot import TOML_FILE, URDF_FILE
from pipeline.serve_clerk import UNNUMBERED, Clerk
from pipeline.serving import Command, Refusal, ServedController, ServingConfig
from recorders.errors import MessageError
from recorders.messages import JointState
from recorders.records import Stamped
from recorders.topics import JOINT_COMMANDS, SESSION_PHASE, type_of
from recorders.wire.frames import (
    DEFAULT_NAMESPACE,
    NO_RUN,
    Frame,
    Kind,
    check_name,
    check_namespace,
    message_key,
    pack,
    unpack,
)
from recorders.wire.session import SessionConfig, open_session
from recorders.writer import LogWriter

MAX_PAYLOAD = 64 << 10
"""Larger payloads are refused unread [bytes]; a pose takes some 100, the joints of a large robot a few thousand."""

_RECENT = 4096  # commands of which the latency is kept
_RATE_OVER_NS = 2 * 10**9
_CDR = "application/cdr;"  # how the encoding of a typed message begins


@dataclass(frozen=True)
class ServeConfig:
    """How a served controller is known and what it keeps.

    Parameters
    ----------
    name : str
        Part of the keys of the liveliness token and of the status.
    namespace : str
        First part of every key.
    serving : ServingConfig
        Learning, washout, what is reported.
    record : Path, optional
        Log to write: the complete ticks that were answered, and the commands.
    overwrite : bool
        Whether a log of this name may be replaced.

    Raises
    ------
    WireError
        If name or namespace cannot be part of a key.
    """

    name: str = "controller"
    namespace: str = DEFAULT_NAMESPACE
    serving: ServingConfig = field(default_factory=ServingConfig)
    record: Path | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        check_name(self.name)
        check_namespace(self.namespace)


def controller_key(namespace: str, name: str, verb: str) -> str:
    """Return the key of a served controller's liveliness token (`alive`) or of its status queryable (`status`)."""
    return f"{namespace}/@controller/{name}/{verb}"


def serve(
    controller: Controller,
    *,
    session: SessionConfig,
    config: ServeConfig | None = None,
    say: Callable[[str], None] = lambda line: None,
    on_end: Callable[[dict[str, Any], Controller], None] = lambda status, controller: None,
) -> None:
    """Serve a controller until the process is told to stop.

    `say` is told, a line each, when the controller is ready and of the first message refused for each reason. However
    the serving ends, the log is finished, and `on_end` is given the last status and the controller as it is then.

    Raises
    ------
    KeyboardInterrupt, SystemExit
        As raised by Ctrl-C or by a handler of SIGTERM, once all is finished.
    ControllerError, RobotError
        If the controller cannot be served.
    WireError
        If no session can be opened.
    LogError
        If the log cannot be begun; at the end, if it could not be written.
    ConfigError
        If learning diverged.
    """
    config = config or ServeConfig()
    writer = _log(controller, config)
    clerk = Clerk(writer, say)
    node, begun = None, False
    try:
        with clerk:
            node = Node(ServedController(controller, config=config.serving, say=clerk.say), config, clerk)
            with open_session(session) as opened, node.declared(opened):
                begun = True
                clerk.say(f"{config.name} serves {message_key(config.namespace, JOINT_COMMANDS)}")
                node.wait()
    finally:
        if node is not None and begun:
            on_end(node.status(), node.controller())


class Node:
    """A served controller between its subscribers and its publisher.

    Samples are handled on the thread that reads them from the network, which saves a target the way to another thread;
    for the same reason each topic has a subscriber of its own, rather than one that hears everything. Commands are
    dropped where the way out is blocked: a late one is worth nothing, and the reading thread must never wait.

    Parameters
    ----------
    served : ServedController
        Answers the targets.
    config : ServeConfig
        Name and namespace.
    clerk : Clerk
        Writes the log.
    """

    def __init__(self, served: ServedController, config: ServeConfig, clerk: Clerk) -> None:
        self._served = served
        self._config = config
        self._clerk = clerk
        self._lock = threading.Lock()  # several connections have several reading threads
        self._stop = threading.Event()
        self._failure: Exception | None = None
        self._commands = 0
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)  # (arrival, latency) [ns]

    @contextmanager
    def declared(self, session: zenoh.Session) -> Iterator[None]:
        """Declare publisher, subscribers, status and, last, the liveliness token: who sees it may send targets."""
        name, namespace = self._config.name, self._config.namespace
        with ExitStack() as stack:
            self._publisher = stack.enter_context(
                session.declare_publisher(
                    message_key(namespace, JOINT_COMMANDS),
                    encoding=f"{_CDR}{JointState.TYPE}",
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.REAL_TIME,
                )
            )
            for topic in (*self._served.topics, SESSION_PHASE):
                handler = zenoh.handlers.Callback(self._handler(topic), indirect=False)
                stack.enter_context(session.declare_subscriber(message_key(namespace, topic), handler))
            stack.enter_context(
                session.declare_queryable(controller_key(namespace, name, "status"), self._answer_query)
            )
            stack.enter_context(session.liveliness().declare_token(controller_key(namespace, name, "alive")))
            yield

    def wait(self) -> None:
        """Return never; raises what serving failed of, or what a signal's handler raises."""
        self._stop.wait()
        if self._failure is not None:
            raise self._failure

    def status(self) -> dict[str, Any]:
        """Return what the controller says of itself, and counts, rate and latencies of this node, as JSON has it.

        `latency_us` is the time from the arrival of the message that completes a tick to the end of the command's put,
        over the last commands; `rate_hz` counts the commands of the last two seconds.
        """
        with self._lock:
            status = self._served.status()
            recent, commands, now = list(self._recent), self._commands, time.perf_counter_ns()
        return {
            "name": self._config.name,
            **status,
            "commands": commands,
            "rate_hz": sum(now - arrival <= _RATE_OVER_NS for arrival, _ in recent) * 1e9 / _RATE_OVER_NS,
            "latency_us": _percentiles([latency for _, latency in recent]),
            "recorded": self._clerk.written,
        }

    def controller(self) -> Controller:
        """Return the controller as it is now."""
        with self._lock:
            return self._served.controller()

    def _handler(self, topic: str) -> Callable[[zenoh.Sample], None]:
        def on_sample(sample: zenoh.Sample) -> None:
            arrival = time.perf_counter_ns()
            try:
                with self._lock:
                    self._take(topic, sample, arrival)
            except Exception as error:
                self._failure = error
                self._stop.set()

        return on_sample

    def _take(self, topic: str, sample: zenoh.Sample, arrival: int) -> None:
        if self._failure is not None:
            return
        if len(sample.payload) > MAX_PAYLOAD:
            self._served.refuse(Refusal.TOO_LARGE, f"{topic}: found {len(sample.payload)} bytes")
            return
        command = self._served.take(self._record(topic, sample))
        if command is not None:
            self._publish(command, arrival)

    def _record(self, topic: str, sample: zenoh.Sample) -> Stamped:
        data = sample.payload.to_bytes()
        if not self._clerk.records:
            return Stamped(topic, _type(topic, sample), data, UNNUMBERED, 0)
        return Stamped(topic, _type(topic, sample), data, _sequence(topic, sample), time.time_ns())

    def _publish(self, command: Command, arrival: int) -> None:
        record = Stamped(JOINT_COMMANDS, JointState.TYPE, command.data, self._commands, command.stamp_ns)
        payload, attachment = pack(Frame(Kind.MESSAGE, NO_RUN, NO_RUN, self._commands, (record,)))
        self._publisher.put(payload, attachment=attachment)
        self._recent.append((arrival, time.perf_counter_ns() - arrival))
        self._commands += 1
        if self._clerk.records:
            for answered in command.answered:
                self._clerk.write(answered)
            self._clerk.write(record._replace(log_time_ns=time.time_ns()))

    def _answer_query(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, json.dumps(self.status()), encoding="application/json")


def _log(controller: Controller, config: ServeConfig) -> LogWriter | None:
    if config.record is None:
        return None
    return LogWriter(
        config.record,
        manifest={
            "kind": "serving",
            "name": config.name,
            "controller": controller.digest,
            "learning": config.serving.learn,
            "washout_steps": config.serving.washout_steps,
        },
        attachments={URDF_FILE: controller.robot_urdf.encode(), TOML_FILE: controller.robot_toml.encode()},
        overwrite=config.overwrite,
    )


def _type(topic: str, sample: zenoh.Sample) -> str:
    """Return the type that the sample's encoding names; without one, that of its topic."""
    encoding = str(sample.encoding)
    return encoding[len(_CDR) :] if encoding.startswith(_CDR) else type_of(topic)


def _sequence(topic: str, sample: zenoh.Sample) -> int:
    """Return the producer's number, if an attachment of ours carries one."""
    if sample.attachment is None or len(sample.attachment) > MAX_PAYLOAD:
        return UNNUMBERED
    try:
        messages = unpack(topic, b"", sample.attachment.to_bytes()).messages
    except MessageError:
        return UNNUMBERED
    return messages[0].sequence if messages else UNNUMBERED


def _percentiles(latencies_ns: list[int]) -> dict[str, float | int | None]:
    values = np.percentile(latencies_ns, [50, 90, 99, 100]).tolist() if latencies_ns else [None] * 4
    named = zip(("p50", "p90", "p99", "max"), values, strict=True)
    return {name: None if value is None else value / 1e3 for name, value in named} | {"commands": len(latencies_ns)}
