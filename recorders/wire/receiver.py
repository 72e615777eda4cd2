"""The receiving end: puts a stream in order, acknowledges what was consumed, and receives live messages."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeAlias

import zenoh

from recorders.errors import MessageError, ReenactError, WireError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.text.wording import escape_control
from recorders.wire.bounded_queue import BoundedQueue
from recorders.wire.channel_table import SenderChannels
from recorders.wire.frames import (
    DEFAULT_NAMESPACE,
    NO_RUN,
    Frame,
    FrameType,
    batch_topic,
    check_name,
    check_namespace,
    control_key,
    message_key,
    unpack,
)
from recorders.wire.history import HistorySubscriber
from recorders.wire.session import publishing
from recorders.wire.stream import MAX_MESSAGE, WINDOW_BYTES, Consumer, Offer, Progress

MAX_PAYLOAD = MAX_MESSAGE + (1 << 16)
"""Larger payloads are refused unread [bytes]: a message, and its entry in a batch."""

_MAX_CONTROL = 16 << 20  # bytes; an offer with a robot's description takes some 30 KB

_ENCODINGS = frozenset(map(str, (zenoh.Encoding.APPLICATION_CDR, zenoh.Encoding.APPLICATION_OCTET_STREAM)))
_FAREWELL = b"farewell "
_FAREWELL_WAIT_S = 5.0  # the sender takes note of the outcome within milliseconds, if it still lives
_ALL_RECEIVED_WAIT_S = 10.0  # Zenoh hands over what it holds within milliseconds
_POLL_S = 1.0
_TAKEN = "{} is already fed by another replay"
_MAX_REASONS = 1000  # anyone may publish on any key: the reports must not fill the memory
_MAX_LINE = 1000  # nor may a single line of it [characters]
_MAX_LEFT = 100  # streams that are over, of which a sender that comes back late is informed
_NAMESAKE_WAIT_S = 2.0  # a consumer that was killed is forgotten within milliseconds of its connection's end
_POLL_NAMESAKE_S = 0.1
_ANSWER_S = 1.0


@dataclass(frozen=True)
class ReceiverConfig:
    """Name, topics and timeouts of a receiver.

    Parameters
    ----------
    name : str
        The name that a sender awaits.
    namespace : str
        First part of every key.
    live : bool
        Whether messages that are not of an accepted stream are handed over too.
    extra_topics : frozenset of str
        Topics on which such a message is worth a word when it is not.
    silence_s : float
        A sender that publishes nothing at all for this long in the middle of a stream is gone [s].
    waiting_bytes : int
        How much may wait here to be taken [bytes]. What comes beyond that is sent again if it is of the stream, and is
        lost and counted as refused if it is live: its publisher, mostly a robot, is never kept waiting.
    latched_topics : frozenset of str
        Topics of which the last message from before this came is handed over too, if its publisher keeps it.
    """

    name: str = "learner"
    namespace: str = DEFAULT_NAMESPACE
    live: bool = False
    extra_topics: frozenset[str] = frozenset()
    silence_s: float = 30.0
    waiting_bytes: int = 256 << 20
    latched_topics: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        """Check the names."""
        check_name(self.name)
        check_namespace(self.namespace)


class ReceivedOffer(NamedTuple):
    """A stream on offer, to be accepted or refused."""

    offer: Offer
    query: zenoh.Query


class LiveMessage(NamedTuple):
    """A message of nobody's stream; without a number of its producer's, its sequence is 0.

    A replay that does not await this consumer is received so, too: then `sender` identifies it.
    """

    record: RecordedMessage
    numbered: bool
    sender: bytes = NO_RUN


Event: TypeAlias = ReceivedOffer | Frame | LiveMessage


class Receiver:
    """Receives over Zenoh, for one consumer.

    Zenoh calls back on threads of its own; they only check a message's place and queue it. Everything else happens on
    the caller's thread: in `serve`, or in a loop of one's own around `next_event`.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : ReceiverConfig
        Name, namespace and patience.
    say : callable
        Told, in one line, of every offer and kind of message that is refused.

    Attributes
    ----------
    refused : counter of str
        How many messages were refused, by topic and reason.
    channels : SenderChannels
        The channels that the senders of streams declare.
    """

    def __init__(
        self,
        session: zenoh.Session,
        *,
        config: ReceiverConfig | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._session = session
        self._config = config or ReceiverConfig()
        self._say = say
        self._lock = threading.Lock()
        self._events: BoundedQueue[Event] = BoundedQueue(limit=self._config.waiting_bytes)
        self._released = threading.Event()  # no sender waits for word from here
        self._released.set()
        self._all_received = threading.Event()  # whatever had arrived before unsubscribing is queued
        self._offer: Offer | None = None  # the one accepted
        self._progress = Progress()
        self._left: dict[str, Progress] = {}  # how streams ended that are over, by sender
        self._acknowledged = 0
        self._consumed_bytes = 0  # since then
        self._last_received_s = time.monotonic()
        self._stack = ExitStack()
        self._reported: set[str] = set()
        self.refused: Counter[str] = Counter()
        self.channels = SenderChannels(session, self._config.namespace, say=self._report_once)

    def __enter__(self) -> Self:
        """Declare the subscriber first: whoever gets an answer to hello can rely on it.

        Raises
        ------
        WireError
            If a consumer of this name is there already: a sender could not distinguish the two.
        """
        name, namespace = self._config.name, self._config.namespace
        self._refuse_namesake()
        enter = self._stack.enter_context
        enter(self._session.liveliness().declare_token(control_key(namespace, name, "alive")))
        enter(self.channels)
        self._subscriptions = self._stack.enter_context(ExitStack())
        history = HistorySubscriber(
            self._session, (message_key(namespace, topic) for topic in self._config.latched_topics), self._on_sample
        )
        self._subscriptions.enter_context(
            self._session.declare_subscriber(
                f"{namespace}/**",
                zenoh.handlers.Callback(history.deliver, drop=self._all_received.set),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        )
        self._subscriptions.enter_context(history)
        self._ack = enter(
            publishing(
                self._session,
                control_key(namespace, name, "ack"),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        )
        enter(self._session.declare_queryable(control_key(namespace, name, "status"), self._on_status))
        enter(self._session.declare_queryable(control_key(namespace, name, "hello"), self._on_hello))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Undeclare everything; the session stays open."""
        self._stack.close()

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
            if not (isinstance(event, ReceivedOffer) and self._offer is not None):
                return event
            self.refuse(event, _TAKEN.format(self._config.name))  # it came while another was being decided
        self._check_silence()
        return None

    def accept(self, offered: ReceivedOffer, start: int) -> None:
        """Take an offer, from the stream index `start` on."""
        with self._lock:
            self._offer = offered.offer
            self._progress = Progress(run=offered.offer.run, next=start, received=start)
            self._acknowledged, self._consumed_bytes = start, 0
            self._released.clear()
            self._last_received_s = time.monotonic()
        self._say(f"{self._config.name} takes run {offered.offer.run[:8]} from message {start} on")
        with offered.query as query:
            self._answer(query, self._progress)

    def refuse(self, offered: ReceivedOffer, reason: str) -> None:
        """Turn an offer down; another may follow."""
        self._report_once(f"refused an offer: {reason}")
        with offered.query as query:
            self._answer(query, Progress(error=reason))

    def consumed(self, frame: Frame) -> None:
        """Note that a frame's messages are consumed, and acknowledge them if it is time."""
        self._update(next=frame.end)
        self._consumed_bytes += frame.size
        if self._offer is None:
            return
        due = frame.end - self._acknowledged >= max(1, self._offer.window // 2)
        if due or self._consumed_bytes >= WINDOW_BYTES // 4:
            self._acknowledged, self._consumed_bytes = frame.end, 0
            self._ack.put(self._progress.to_json())

    def finish(self, result: dict[str, Any]) -> None:
        """Report the result of the stream, which is through, and wait until the sender has it or has gone."""
        self.report(result)
        if not self._released.wait(_FAREWELL_WAIT_S):
            self.abandon_stream()

    def report(self, result: dict[str, Any]) -> None:
        """Report the result of the stream, which is through; `is_released` is true once the sender needs no more."""
        self._last_received_s = time.monotonic()
        self._update(result=result)
        self._ack.put(self._progress.to_json())

    def is_released(self, timeout_s: float = 0.0) -> bool:
        """Whether no sender waits for word from here, now or within the time [s].

        Once the result is reported, that is when the sender has the results of all whom it awaits, so that they have
        reported all that they had to report of the stream; or when it has gone, or was silent for too long.
        """
        if not self._released.wait(timeout_s) and time.monotonic() - self._last_received_s > _FAREWELL_WAIT_S:
            self.abandon_stream()
        return self._released.is_set()

    def reporting_failure(self) -> "_ReportingFailure":
        """Return a context that reports an exception which leaves it to the sender."""
        return _ReportingFailure(self)

    def fail(self, reason: str) -> None:
        """Inform the sender, if it still lives, that its stream is given up, and why."""
        self._update(error=reason)
        self._ack.put(self._progress.to_json())
        self._released.wait(_FAREWELL_WAIT_S)

    def abandon_stream(self, reason: str = "the stream was given up") -> None:
        """Leave the stream under way to itself, as its sender has; the next offer is welcome.

        A sender that comes back nevertheless gets the reason, and nothing more of its stream is taken.
        """
        with self._lock:
            if self._offer is not None:
                self._remember(self._offer, reason)
            self._offer = None
        self._released.set()

    def unsubscribe(self) -> None:
        """Take in no more messages; `next_event` need not wait for those that have arrived."""
        self._subscriptions.close()
        self._all_received.wait(_ALL_RECEIVED_WAIT_S)

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        return self._progress

    @property
    def offer(self) -> Offer | None:
        """The offer that was accepted and is not through yet."""
        return self._offer

    def _refuse_namesake(self) -> None:
        key = control_key(self._config.namespace, self._config.name, "alive")
        deadline = time.monotonic() + _NAMESAKE_WAIT_S
        while any(reply.ok is not None for reply in self._session.liveliness().get(key, timeout=_ANSWER_S)):
            if time.monotonic() >= deadline:
                raise WireError(
                    f"a consumer '{self._config.name}' is in namespace '{self._config.namespace}' already: "
                    "end it, or choose another --name"
                )
            time.sleep(_POLL_NAMESAKE_S)

    def _remember(self, offer: Offer, reason: str) -> None:
        """Keep how a stream ended, for as many as there is room; live messages are of no sender."""
        if bytes.fromhex(offer.sender) == NO_RUN:
            return
        over = self._progress.result is not None or self._progress.error is not None
        self._left[offer.sender] = self._progress if over else replace(self._progress, error=reason)
        while len(self._left) > _MAX_LEFT:
            del self._left[next(iter(self._left))]

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
                    self._released.set()
                    raise WireError(f"the sender gave up at message {self._progress.next}: {event.reason}")
                yield from event.messages
                self.consumed(event)

    def _check_silence(self) -> None:
        silent_s = time.monotonic() - self._last_received_s
        under_way = self._offer is not None and self._progress.result is None and self._progress.error is None
        if under_way and silent_s > self._config.silence_s:
            self._released.set()
            raise WireError(
                f"the sender fell silent {silent_s:.0f} s ago, before message {self._progress.received}: "
                "it was killed, or the connection is gone"
            )

    def _update(self, **changes: Any) -> None:
        with self._lock:
            self._progress = replace(self._progress, **changes)

    # From here on: Zenoh's threads.

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return  # a deleted key is no message
        topic = "/" + str(sample.key_expr).removeprefix(self._config.namespace + "/")
        if len(sample.payload) > MAX_PAYLOAD:
            self._refuse_message(topic, f"{len(sample.payload)} bytes, expected at most {MAX_PAYLOAD}")
            return
        try:
            frame = self._framed(topic, sample)
        except MessageError as error:
            self._refuse_message(topic, str(error).removeprefix(f"{topic}: "))
            return
        if self._offer is not None and frame is not None and (frame.run, frame.sender) == self._offer.identity:
            self._last_received_s = time.monotonic()
            self._queue_in_order(frame)
        elif frame is not None and frame.sender.hex() in self._left:
            return  # of a stream that is over; its sender learns so when it asks
        elif self._config.live:
            self._queue_live(topic, sample, frame)
        elif self._offer is not None and topic in self._config.extra_topics:
            self._refuse_message(topic, "not of the stream that is under way")

    def _framed(self, topic: str, sample: zenoh.Sample) -> Frame | None:
        """Return the frame that a sample is, None if it carries no attachment of ours.

        Others may attach to live messages what they like; on the key of batches there are none.
        """
        if sample.attachment is None:
            return None
        if len(sample.attachment) > _MAX_CONTROL:
            raise MessageError(f"{topic}: an attachment of {len(sample.attachment)} bytes")
        try:
            frame = unpack(topic, sample.payload.to_bytes(), sample.attachment.to_bytes())
        except MessageError:
            if self._config.live and topic != batch_topic():
                return None
            raise
        if frame.kind is FrameType.MESSAGE and not frame.messages[0].type:
            return frame._replace(messages=(frame.messages[0]._replace(type=_schema_of(sample)),))
        return frame

    def _queue_live(self, topic: str, sample: zenoh.Sample, frame: Frame | None) -> None:
        kind = type_of(topic) or _schema_of(sample)
        if frame is None:
            self._put_live(
                LiveMessage(RecordedMessage(topic, kind, sample.payload.to_bytes(), 0, time.time_ns()), numbered=False)
            )
            return
        for record in frame.messages:
            self._put_live(LiveMessage(record._replace(type=record.type or kind), numbered=True, sender=frame.sender))

    def _put_live(self, live: LiveMessage) -> None:
        if not self._events.put(live, len(live.record.data)):
            self._refuse_message(live.record.topic, f"lost, as {self._config.waiting_bytes} bytes wait already")

    def _queue_in_order(self, frame: Frame) -> None:
        """Queue what is new of a frame; what came before is a repeat, what comes after a gap is sent again."""
        received = self._progress.received
        if frame.kind is FrameType.ABORT and self._progress.result is not None:
            self.abandon_stream()  # all of it is here; somebody else who was awaited has failed
            return
        if frame.kind is FrameType.ABORT:
            self._events.put(frame._replace(reason=escape_control(frame.reason[:_MAX_LINE])), len(frame.reason))
            return
        in_place = frame.first <= received
        new = frame.end > received or (frame.kind is FrameType.END and frame.first == received)
        if in_place and new:
            rest = frame._replace(first=received, messages=frame.messages[received - frame.first :])
            if self._events.put(rest, rest.size):
                self._update(received=frame.end)

    def _refuse_message(self, topic: str, reason: str) -> None:
        if len(self.refused) >= _MAX_REASONS and f"{topic}: {reason}" not in self.refused:
            topic, reason = "other topics", "refused"
        self.refused[f"{topic}: {reason}"] += 1
        self._report_once(f"refused a message on {topic}: {reason}")

    def _report_once(self, line: str) -> None:
        """Report a line once, as anybody may cause it again and again."""
        line = escape_control(line[:_MAX_LINE])
        if line not in self._reported and len(self._reported) < _MAX_REASONS + 1:  # one more: "other topics"
            self._reported.add(line)
            self._say(line)

    def _on_hello(self, query: zenoh.Query) -> None:
        try:
            offer = Offer.from_json(_payload(query))
        except WireError as error:
            with query:
                self._answer(query, Progress(error=str(error)))
            return
        taken, left = self._offer, self._left.get(offer.sender)
        if taken is None and left is None and self._events.put(ReceivedOffer(offer, query), len(_payload(query))):
            return
        with query:
            if taken is not None and taken.sender == offer.sender:
                self._answer(query, self._progress)
            elif left is not None:
                self._answer(query, left)
            else:
                self._report_once(f"refused an offer: {_TAKEN.format(self._config.name)}")
                self._answer(query, Progress(error=_TAKEN.format(self._config.name)))

    def _on_status(self, query: zenoh.Query) -> None:
        with query:
            offer, progress, asked = self._offer, self._progress, _payload(query)
            self._answer(query, self._left.get(_asker(asked), progress))
            if offer is None or asked not in (asking(offer), asking(offer, farewell=True)):
                return  # anyone may ask, and changes nothing by it
            self._last_received_s = time.monotonic()
            if progress.error is not None or (progress.result is not None and asked == asking(offer, farewell=True)):
                self.abandon_stream()

    def _answer(self, query: zenoh.Query, progress: Progress) -> None:
        query.reply(query.key_expr, progress.to_json())


def asking(offer: Offer, *, farewell: bool = False) -> bytes:
    """Return what a sender asks a consumer's `status` with: who it is, and whether it has all that it needs."""
    return (_FAREWELL if farewell else b"") + offer.sender.encode()


class _ReportingFailure:
    """Reports an exception to the sender, and lets it pass."""

    def __init__(self, receiver: Receiver) -> None:
        self._receiver = receiver

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            known = isinstance(error, ReenactError)
            self._receiver.fail(str(error) if known else f"stopped by {type(error).__name__}")


def _asker(asked: bytes) -> str:
    """Return the sender that asks, from the bytes that `asking` wrote."""
    return asked.removeprefix(_FAREWELL).decode(errors="replace")


def _payload(query: zenoh.Query) -> bytes:
    return b"" if query.payload is None or len(query.payload) > _MAX_CONTROL else query.payload.to_bytes()


def _schema_of(sample: zenoh.Sample) -> str:
    """Return the type that a sample's encoding names, such as `application/cdr;TYPE`, or an empty string."""
    encoding, _, schema = str(sample.encoding).partition(";")
    return schema if encoding in _ENCODINGS else ""
