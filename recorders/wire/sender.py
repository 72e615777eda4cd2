"""The sending end over Zenoh: drives the machine that sends a stream, asks whom it wants asked, and keeps its time."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from types import MappingProxyType
from typing import Any, Self, TypeAlias

import zenoh

from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import FrameType
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.sender import SenderMachine
from recorders.protocol.states import SenderState
from recorders.rmw_zenoh.qos import Qos
from recorders.threads import background_thread
from recorders.wire.bounded_queue import LONGEST_WAIT_S
from recorders.wire.keys.namespace import control_key
from recorders.wire.keys.topic_keys import EVERY_TOPIC, MessagePublisher, TopicKeys
from recorders.wire.queries import read_packet
from recorders.wire.session import has_subscribers

Batches: TypeAlias = Iterator[tuple[RecordedMessage, ...]]

_NO_QOS: Mapping[str, Qos] = MappingProxyType({})
_LISTENER_WAIT_S = 2.0  # a listener that is connected is known within milliseconds; one may just be starting


def find_listener(session: zenoh.Session, keys: TopicKeys) -> bool:
    """Wait a little for anyone who listens: what is put before Zenoh knows of a subscriber never reaches it."""
    deadline_s = time.monotonic() + _LISTENER_WAIT_S
    with session.declare_publisher(keys.key(EVERY_TOPIC), allowed_destination=zenoh.Locality.REMOTE) as probe:
        while not has_subscribers(probe):
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.01)
    return True


class StreamSender:
    """Sends one stream over Zenoh, while the block of `running` runs.

    The stream is read on the caller's thread, which may take its time; another keeps the machine's time meanwhile.
    Zenoh's threads only hand in what came.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    machine : SenderMachine
        What decides; not started yet.
    consumers : tuple of str
        Whose acknowledgements are taken.
    encoding : callable
        Returns the encoding of a message that travels alone.
    qos : mapping of str to Qos
        What is offered on topics of a ROS domain, where it is not what their own nodes offer.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: TopicKeys,
        machine: SenderMachine,
        consumers: tuple[str, ...],
        *,
        encoding: Callable[[RecordedMessage], str],
        qos: Mapping[str, Qos] = _NO_QOS,
    ) -> None:
        self._session = session
        self._keys = keys
        self._machine = machine
        self._consumers = consumers
        self._encoding = encoding
        self._qos = qos
        self._lock = threading.Lock()  # held for each step of the machine
        self._changed = threading.Condition(self._lock)  # the stream may go on, or is over
        self._due = threading.Condition(self._lock)  # there is something to ask or to send again
        self._unanswered: list[Ask] = []  # greetings
        self._broken: BaseException | None = None  # what ended the thread that keeps time
        self._leaving = False
        self._wakes_s = 0.0  # when the thread that keeps time wakes by itself
        self._declaring = threading.Lock()
        self._publishers: dict[tuple[str, str], MessagePublisher] = {}
        self._stack = ExitStack()

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Take acknowledgements and keep time while the block runs."""
        with self._stack:
            for name in self._consumers:
                key = control_key(self._keys.namespace, name, "ack")
                self._stack.enter_context(self._session.declare_subscriber(key, self._on_ack(name)))
            # No daemon: the threads on which Zenoh hands in answers would be daemons as well, as it is this one that
            # asks, and a daemon that returns from Zenoh while the interpreter ends aborts the process.
            with background_thread(self._keep_time, name="stream", stop=self._leave, daemon=False):
                yield self

    def publisher(self, topic: str, type_name: str = "") -> MessagePublisher:
        """Return the publisher of a topic's messages of a type."""
        with self._declaring:
            if (topic, type_name) not in self._publishers:
                # The default, DROP, loses a third of a burst.
                blocking = zenoh.CongestionControl.BLOCK
                publisher = self._keys.publishing(
                    self._session, topic, type_name, qos=self._qos.get(topic), congestion_control=blocking
                )
                self._publishers[topic, type_name] = self._stack.enter_context(publisher)
            return self._publishers[topic, type_name]

    def deliver(
        self,
        batches_from: Callable[[int], Batches],
        *,
        before_each: Callable[[], None],
        on_progress: Callable[[int], None],
        is_exempt: Callable[[str], bool],
    ) -> dict[str, dict[str, Any]]:
        """Deliver the stream and return the consumers' results by name.

        Parameters
        ----------
        batches_from : callable
            Gives the stream from an index on, as it is cut.
        before_each : callable
            Called before each batch is sent; what it raises ends the stream.
        on_progress : callable
            Called with how many messages every consumer has consumed.
        is_exempt : callable
            Whether somebody of a consumer's name is there who acknowledges nothing; called where no hello is answered.

        Raises
        ------
        WireError
            If a consumer is not there, refuses, stops, or falls silent.
        """
        self._is_exempt, self._on_progress = is_exempt, on_progress
        with self._lock:
            self._machine.start(time.monotonic())
            self._notify()
        while True:
            self._await(lambda: self._machine.state is SenderState.SENDING or self._machine.is_over)
            if self._machine.is_over:
                return self._results()
            self._send_from(self._machine.sent, batches_from, before_each)

    def abort(self, reason: str) -> None:
        """Inform the consumers that the stream is given up, as well as the connection allows."""
        with self._lock:
            self._machine.abort(reason)
            actions = self._machine.outbox.take()
        with suppress(zenoh.ZError):
            self._see_to(actions)

    def _results(self) -> dict[str, dict[str, Any]]:
        if self._machine.error is not None:
            raise self._machine.error
        return self._machine.results

    def _send_from(self, index: int, batches_from: Callable[[int], Batches], before_each: Callable[[], None]) -> None:
        """Send the stream from an index to its end, or until the machine wants it from elsewhere."""
        for messages in batches_from(index):
            before_each()
            if not self._send(index, messages):
                return
            index += len(messages)
        with self._lock:
            if self._wants(index):
                self._machine.end()
            actions = self._machine.outbox.take()
        self._see_to(actions)

    def _send(self, index: int, messages: tuple[RecordedMessage, ...]) -> bool:
        """Send messages as soon as there is room; False if the machine wants others."""
        sent = False

        def is_settled() -> bool:
            nonlocal sent
            sent = self._wants(index) and self._machine.send(messages)
            return sent or not self._wants(index)

        self._await(is_settled)
        return sent

    def _wants(self, index: int) -> bool:
        """Whether the machine wants the stream from an index on."""
        return self._machine.state is SenderState.SENDING and self._machine.sent == index

    def _await(self, is_settled: Callable[[], bool]) -> None:
        """Wait until something is so, which is asked whenever the machine has moved, and see to what that leads to."""
        settled = False
        while not settled:
            with self._lock:
                woken = self._changed.wait_for(lambda: self._unanswered or self._broken or is_settled(), LONGEST_WAIT_S)
                unanswered, self._unanswered = self._unanswered, []
                settled = bool(woken) and not unanswered
                actions = self._machine.outbox.take()
            if self._broken is not None:
                raise self._broken
            self._see_to(actions)
            for ask in unanswered:
                self._take_unanswered(ask)
            self._on_progress(self._machine.consumed)

    def _take_unanswered(self, ask: Ask) -> None:
        exempt = self._is_exempt(ask.consumer)
        with self._lock:
            if exempt:
                self._machine.exempt(ask, time.monotonic())
            else:
                self._machine.on_answer(ask, None, time.monotonic())
            self._notify()

    def _see_to(self, actions: list[Action]) -> None:
        """Publish and ask what the machine wants published and asked."""
        for action in actions:
            if isinstance(action, Publish):
                self._publish(action)
            else:
                self._ask(action)

    def _publish(self, action: Publish) -> None:
        single = action.frame.messages[0] if action.frame.kind is FrameType.MESSAGE else None
        encoding = None if single is None else self._encoding(single)
        publisher = self.publisher(action.topic, "" if single is None else single.type)
        publisher.put(action.packet.payload, attachment=action.packet.attachment, encoding=encoding)

    def _ask(self, ask: Ask) -> None:
        """Ask whoever has a consumer's keys: others than the consumer may answer, and before it does.

        All answers are handed in, and then that there are no more, on a thread of Zenoh's.
        """

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._take_answer(ask, read_packet(reply.ok.payload, reply.ok.attachment))

        self._session.get(
            control_key(self._keys.namespace, ask.consumer, ask.verb),
            zenoh.handlers.Callback(on_reply, drop=lambda: self._take_answer(ask, None)),
            target=zenoh.QueryTarget.ALL,  # by default, the nearest that claims to be complete is asked alone
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=ask.packet.payload,
            attachment=ask.packet.attachment or None,
            timeout=ask.timeout_s,
        )

    def _take_answer(self, ask: Ask, answer: Packet | None) -> None:
        with self._lock:
            if answer is not None or ask.verb != "hello":
                self._machine.on_answer(ask, answer, time.monotonic())
            elif self._machine.awaits(ask):
                self._unanswered.append(ask)
            self._notify()

    def _on_ack(self, name: str) -> Callable[[zenoh.Sample], None]:
        def note(sample: zenoh.Sample) -> None:
            packet = read_packet(sample.payload, sample.attachment)
            with self._lock:
                self._machine.on_acknowledgement(name, packet, time.monotonic())
                self._notify()

        return note

    def _notify(self) -> None:
        """Wake whoever has something to do now."""
        self._changed.notify()
        if self._machine.outbox or self._machine.deadline_s < self._wakes_s:
            self._due.notify()

    def _leave(self) -> None:
        with self._lock:
            self._leaving = True
            self._due.notify()

    def _keep_time(self) -> None:
        """Ask whom it is time to ask, and send again what is lacking, until the block ends."""
        try:
            while not self._leaving:
                self._see_to(self._next_actions())
        except BaseException as error:
            with self._lock:
                self._broken = error
                self._changed.notify()

    def _next_actions(self) -> list[Action]:
        """Wait until there is something to be done."""
        with self._lock:
            while not (self._leaving or self._machine.outbox):
                self._wakes_s = self._machine.deadline_s
                left_s = self._wakes_s - time.monotonic()
                if left_s > 0.0:
                    self._due.wait(min(left_s, threading.TIMEOUT_MAX))
                else:
                    self._machine.on_time(time.monotonic())
                    self._changed.notify()
            return [] if self._leaving else self._machine.outbox.take()
