"""The receiving end over Zenoh, for one consumer: a stream in order and acknowledged, and live messages."""

import logging
import math
import secrets
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

import zenoh

from recorders.errors import ReenactError, WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.packets import Packet
from recorders.protocol.receiver import FAREWELL_WAIT_S, GIVEN_UP, ReceiverMachine
from recorders.protocol.seals.authentication import INSTANCE_BYTES
from recorders.protocol.stream import Consumer, Offer, Progress
from recorders.wire.bounded_queue import BoundedQueue
from recorders.wire.channel_table import SenderChannels
from recorders.wire.keys.namespace import check_name
from recorders.wire.keys.topic_keys import KeyedTopic, NamespaceKeys, TopicKeys
from recorders.wire.queries import Answer, ConsumerQueries, ReceivedOffer, only_of_its_name
from recorders.wire.refusals import Refusals
from recorders.wire.shared_key import shared_key
from recorders.wire.subscription import LiveMessage, Received, Subscription, live_messages, schema_of

logger = logging.getLogger(__name__)

_POLL_S = 1.0

Event: TypeAlias = ReceivedOffer | Frame | LiveMessage


@dataclass(frozen=True)
class ReceiverConfig:
    """Name, topics and timeouts of a receiver.

    Parameters
    ----------
    name : str
        The name that a sender awaits.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    live : bool
        Whether messages that are not of an accepted stream are handed over too.
    extra_topics : frozenset of str
        Topics on which such a message is worth a word when it is not.
    silence_s : float
        A sender that publishes nothing at all for this long in the middle of a stream is gone [s].
    waiting_bytes : int
        How much may wait here to be taken [bytes]. What comes beyond that is sent again if it is of the stream, and is
        lost and counted as refused if it is live: its publisher, mostly a robot, is never kept waiting.
    topics : mapping of str to str, optional
        Types of the topics that are wanted, so that no others need be sent here until a stream is accepted; all if left
        out.
    latched_topics : frozenset of str
        Topics of which the last message from before this came is handed over too, if its publisher keeps it.
    key_file : Path, optional
        File with the key that it shares with senders; if left out, the user's own.
    use_sim_time : bool
        Whether live messages arrive at the time of `/clock`.
    """

    name: str = "learner"
    keys: TopicKeys = field(default_factory=NamespaceKeys)
    live: bool = False
    extra_topics: frozenset[str] = frozenset()
    silence_s: float = 30.0
    waiting_bytes: int = 256 << 20
    topics: Mapping[str, str] | None = None
    latched_topics: frozenset[str] = frozenset()
    key_file: Path | None = None
    use_sim_time: bool = False

    def __post_init__(self) -> None:
        """Check the name."""
        check_name(self.name)

    @property
    def namespace(self) -> str:
        """First part of the control keys."""
        return self.keys.namespace


class Receiver:
    """Receives over Zenoh, for one consumer.

    Zenoh calls back on threads of its own; they only have the machine look at what came, and queue it. Everything else
    happens on the caller's thread: in `serve`, or in a loop of one's own around `next_event`.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : ReceiverConfig
        Name, namespace and patience.

    Attributes
    ----------
    refused : counter of str
        How many messages were refused, by topic and reason.
    channels : SenderChannels
        The channels that the senders of streams declare.
    """

    def __init__(self, session: zenoh.Session, *, config: ReceiverConfig | None = None) -> None:
        self._session = session
        self._config = config or ReceiverConfig()
        self._events: BoundedQueue[Event] = BoundedQueue(limit=self._config.waiting_bytes)
        self._refusals = Refusals()
        self._machine = ReceiverMachine(
            self._config.name,
            key=shared_key(self._config.key_file),
            instance=secrets.token_bytes(INSTANCE_BYTES),
            silence_s=self._config.silence_s,
            refuse=lambda verb, reason: self._refusals.count(f"@consumer/{self._config.name}/{verb}", reason),
        )
        self._lock = threading.Lock()  # held for each step of the machine
        self._released = threading.Condition(self._lock)
        self._stack = ExitStack()
        self.channels = SenderChannels(session, self._config.namespace)
        self._subscription = Subscription(
            session,
            self._config.keys,
            hand_over=self._on_live,
            refuse=self._refusals.count,
            topics=self._config.topics,
            latched_topics=self._config.latched_topics,
            live=self._config.live,
            take_stream=self._on_stream,
            use_sim_time=self._config.use_sim_time,
        )
        self._queries = ConsumerQueries(
            session, self._config.namespace, self._config.name, on_hello=self._on_hello, on_status=self._on_status
        )

    def __enter__(self) -> Self:
        """Declare the subscriber first: whoever gets an answer to hello can rely on it.

        Raises
        ------
        WireError
            If a consumer of this name is there already: a sender could not distinguish the two.
        """
        with ExitStack() as stack:
            stack.enter_context(only_of_its_name(self._session, self._config.namespace, self._config.name))
            stack.enter_context(self.channels)
            stack.enter_context(self._subscription)
            stack.enter_context(self._queries)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Undeclare everything; the session stays open."""
        self._stack.close()

    @property
    def refused(self) -> Counter[str]:
        """How many messages were refused, by topic and reason."""
        return self._refusals.counts

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        return self._machine.progress

    @property
    def offer(self) -> Offer | None:
        """The offer that was accepted and is not through yet."""
        return self._machine.offer

    def serve(self, consumer: Consumer, *, wait_s: float = math.inf) -> dict[str, Any]:
        """Wait for an offer that the consumer takes, feed it the stream, and return its result.

        Parameters
        ----------
        consumer : Consumer
            Takes the messages, in order and without a gap.
        wait_s : float
            How long to wait for the first accepted offer [s]; for ever if left out.

        Raises
        ------
        WireError
            If no offer came, or the sender failed or fell silent.
        ReenactError
            Whatever the consumer raised; the sender is informed.
        """
        self._await_offer(consumer, wait_s)
        with self.reporting_failure():
            result = consumer.consume(self._messages())
        self.finish(result)
        return result

    def next_event(self, timeout_s: float) -> Event | None:
        """Return what came next, or None if nothing did within the time [s].

        Raises
        ------
        WireError
            If a stream is under way and its sender has been silent for too long.
        """
        while (event := self._events.get(timeout_s)) is not None:
            if not (isinstance(event, ReceivedOffer) and self._is_answered(event)):
                return event
        with self._lock:
            error = self._machine.on_time(time.monotonic())
        if error is not None:
            raise error
        return None

    def accept(self, event: ReceivedOffer, start: int) -> None:
        """Take an offer, from the stream index `start` on."""
        with self._lock:
            answer = self._machine.accept(event.offered, start, time.monotonic())
        self._subscription.take_all()
        logger.info(f"{self._config.name} takes run {event.offer.run[:8]} from message {start} on")
        event.answer(answer)

    def refuse(self, event: ReceivedOffer, reason: str) -> None:
        """Turn an offer down; another may follow."""
        self._refusals.report(f"refused an offer: {reason}")
        with self._lock:
            answer = self._machine.refuse(event.offered, reason)
        event.answer(answer)

    def own_name(self, topic: str) -> str:
        """Return the name that this node has for a topic of a stream."""
        return self._config.keys.received_as(topic)

    def own_records(self, frame: Frame) -> tuple[RecordedMessage, ...]:
        """Return a frame's messages under the names that this node has for their topics."""
        if not self._config.keys.renames:
            return frame.messages
        return tuple(record._replace(topic=self.own_name(record.topic)) for record in frame.messages)

    def consumed(self, frame: Frame) -> None:
        """Note that a frame's messages are consumed, and acknowledge them if it is time."""
        with self._lock:
            acknowledgement = self._machine.consume(frame)
        if acknowledgement is not None:
            self._queries.acknowledge(acknowledgement)

    def finish(self, result: dict[str, Any]) -> None:
        """Report the result of the stream, which is through, and wait until the sender has it or has gone."""
        self.report(result)
        if not self._await_release(FAREWELL_WAIT_S):
            self.abandon_stream()

    def report(self, result: dict[str, Any]) -> None:
        """Report the result of the stream, which is through; `is_released` is true once the sender needs no more."""
        with self._lock:
            report = self._machine.finish(result, time.monotonic())
        if report is not None:
            self._queries.acknowledge(report)

    def is_released(self, timeout_s: float = 0.0) -> bool:
        """Whether no sender waits for word from here, now or within the time [s].

        Once the result is reported, that is when the sender has the results of all whom it awaits, so that they have
        reported all that they had to report of the stream; or when it has gone, or was silent for too long.
        """
        if self._await_release(timeout_s):
            return True
        with self._lock:
            if self._machine.progress.is_final:
                self._machine.on_time(time.monotonic())
            return self._machine.released

    @contextmanager
    def reporting_failure(self) -> Iterator[None]:
        """Report an exception that leaves the block to the sender, and let it pass."""
        try:
            yield
        except BaseException as error:
            self.fail(str(error) if isinstance(error, ReenactError) else f"stopped by {type(error).__name__}")
            raise

    def fail(self, reason: str) -> None:
        """Inform the sender, if it still lives, that its stream is given up, and why."""
        with self._lock:
            report = self._machine.fail(reason, time.monotonic())
        if report is not None:
            self._queries.acknowledge(report)
        self._await_release(FAREWELL_WAIT_S)

    def abandon_stream(self, reason: str = GIVEN_UP) -> None:
        """Leave the stream under way to itself, as its sender has; the next offer is welcome.

        A sender that comes back nevertheless gets the reason, and nothing more of its stream is taken.
        """
        with self._lock:
            self._machine.abandon(reason)
            self._released.notify_all()

    def unsubscribe(self) -> None:
        """Take in no more messages; `next_event` need not wait for those that have arrived."""
        self._subscription.close()

    def _await_release(self, timeout_s: float) -> bool:
        """Return whether no sender waits for an answer, now or within the time [s]."""
        with self._lock:
            return self._released.wait_for(lambda: self._machine.released, timeout_s)

    def _await_offer(self, consumer: Consumer, wait_s: float) -> None:
        deadline = time.monotonic() + wait_s
        while True:
            event = self.next_event(deadline - time.monotonic())
            if isinstance(event, ReceivedOffer):
                try:
                    start = consumer.hello(event.offer)
                except ReenactError as error:
                    self.refuse(event, str(error))
                    continue
                self.accept(event, start)
                return
            if time.monotonic() >= deadline:
                raise WireError(f"{self._config.name}: nobody offered a stream within {wait_s:g} s")

    def _messages(self) -> Iterator[RecordedMessage]:
        """Yield the stream; a frame counts as consumed when the message after it is asked for."""
        while True:
            event = self.next_event(_POLL_S)
            if isinstance(event, LiveMessage):
                yield event.record
            elif isinstance(event, Frame):
                if event.kind is FrameType.END:
                    return
                if event.kind is FrameType.ABORT:
                    raise WireError(event.reason)
                yield from self.own_records(event)
                self.consumed(event)

    def _is_answered(self, event: ReceivedOffer) -> bool:
        """Answer an offer that came while another was being decided."""
        with self._lock:
            answer = self._machine.answer(event.offered)
        if answer is not None:
            event.answer(answer)
        return answer is not None

    # From here on: Zenoh's threads.

    def _on_stream(self, topic: KeyedTopic, sample: zenoh.Sample, attachment: bytes) -> bool:
        if not self._machine.concerns(attachment):
            return False
        packet = Packet(sample.payload.to_bytes(), attachment)
        with self._lock:
            kind = topic.type or schema_of(sample)
            frame = self._machine.on_sample(topic.sent_as, packet, time.monotonic(), type_name=kind)
            # An abort comes once, and the last of a stream.
            if frame is not None and self._events.put(
                frame, frame.size or len(frame.reason), always=frame.kind is FrameType.ABORT
            ):
                self._machine.arrived(frame)
            if self._machine.released:
                self._released.notify_all()
        return True

    def _on_live(self, received: Received) -> None:
        topic = received.topic.topic
        if self._config.live:
            for message in live_messages(received, self._config.keys):
                if not self._events.put(message, len(message.record.data)):
                    self._refusals.count(
                        message.record.topic, f"lost, as {self._config.waiting_bytes} bytes wait already"
                    )
        elif self.offer is not None and topic in self._config.extra_topics:
            self._refusals.count(topic, "not of the stream that is under way")

    def _on_hello(self, packet: Packet, answer: Answer) -> None:
        with self._lock:
            offered = self._machine.on_hello(packet)
            if not isinstance(offered, Packet):
                if self._events.put(ReceivedOffer(offered, answer), offered.size):
                    self._machine.waiting(offered)
                return  # its sender offers it again, unless it is answered
        answer(offered)

    def _on_status(self, packet: Packet, answer: Answer) -> None:
        with self._lock:
            progress = self._machine.on_status(packet)
        answer(progress)
        with self._lock:
            self._machine.on_status_answered(packet, progress, time.monotonic())
            self._released.notify_all()
