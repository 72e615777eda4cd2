"""Subscribes to all topics, and reads each sample as a frame of a stream or as a live message."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from typing import NamedTuple, Self, TypeAlias

import zenoh

from recorders.errors import MessageError
from recorders.messages.message_types import Clock
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK, type_of
from recorders.protocol.frames import MAX_PAYLOAD, NO_RUN, Frame, FrameType, batch_topic, unpack
from recorders.rmw_zenoh.attachment import Attachment
from recorders.wire.history import HistorySubscriber
from recorders.wire.keys.topic_keys import KeyedTopic, TopicKeys
from recorders.wire.queries import MAX_CONTROL
from recorders.wire.sim_time import NO_TIME, SimTime

_ENCODINGS = frozenset(map(str, (zenoh.Encoding.APPLICATION_CDR, zenoh.Encoding.APPLICATION_OCTET_STREAM)))
_ALL_RECEIVED_WAIT_S = 10.0  # Zenoh hands over what it holds within milliseconds


class LiveMessage(NamedTuple):
    """A message of nobody's stream; without a number of its producer's, its sequence is 0.

    A replay that does not await this consumer is received so, too: then there is a `run`. The `sender` is that replay,
    or else the publisher that numbered it, and `sent_as` the topic as it names it. The `origin` is what a publisher in
    a ROS domain attached, the `type_hash` that of its type's definition, as the key there states it, and `stamp` the
    time and session that Zenoh states.
    """

    record: RecordedMessage
    numbered: bool
    run: bytes = NO_RUN
    sender: bytes = NO_RUN
    sent_as: str = ""
    origin: Attachment | None = None
    type_hash: str = ""
    stamp: zenoh.Timestamp | None = None

    @property
    def stamped_by(self) -> str:
        """The session that stamped it, mostly its publisher's; empty if none did."""
        return "" if self.stamp is None else str(self.stamp.get_id())


class Received(NamedTuple):
    """A sample, read as far as its attachment: the frame that it is, None if it has no attachment of ours."""

    topic: KeyedTopic
    sample: zenoh.Sample
    frame: Frame | None
    origin: Attachment | None = None
    time_ns: int = 0  # when it arrived

    @property
    def type(self) -> str:
        """Type of its messages; empty if it is unknown."""
        return self.topic.type or type_of(self.topic.topic) or schema_of(self.sample)


HandOver: TypeAlias = Callable[[Received], None]
"""Takes what is received."""

TakeStream: TypeAlias = Callable[[KeyedTopic, zenoh.Sample, bytes], bool]
"""Takes a topic, a sample and its attachment of ours; False if they are of no stream that anybody here awaits."""


class Subscription:
    """A subscription to all topics, and to what publishers cache of some of them.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : TopicKeys
        Keys of the topics.
    hand_over : callable
        Takes what is received, on threads of Zenoh's.
    refuse : callable
        Takes topic and reason of what is neither a message nor a frame.
    topics : mapping of str to str, optional
        Types of the topics that are wanted, which is seen in a ROS domain; all if left out.
    latched_topics : iterable of str
        Topics of which the last message from before this came is received too, if its publisher caches it.
    live : bool
        Whether attachments of others are passed over: they may attach to live messages what they like.
    take_stream : callable
        Takes what is of a stream, before anything else looks at it; raises MessageError to refuse it.
    use_sim_time : bool
        Whether messages arrive at the time of `/clock`, and not of the clock on the wall; what comes before the first
        message there is refused.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: TopicKeys,
        *,
        hand_over: HandOver,
        refuse: Callable[[str, str], None],
        topics: Mapping[str, str] | None = None,
        latched_topics: Iterable[str] = (),
        live: bool = False,
        take_stream: TakeStream = lambda topic, sample, attachment: False,
        use_sim_time: bool = False,
    ) -> None:
        self._session = session
        self._keys = keys
        self._hand_over = hand_over
        self._refuse = refuse
        self._live = live
        self._take_stream = take_stream
        self._sim_time = SimTime() if use_sim_time else None
        if topics is not None and use_sim_time:
            topics = {**topics, CLOCK: Clock.TYPE}
        self._topics = topics or {}
        self._wanted = {topic: keys.expressions(topic, kind) for topic, kind in self._topics.items()}
        self._selected = keys.everything if topics is None else keys.selection(topics)
        latched = (key for topic in latched_topics for key in keys.expressions(topic, self._topics.get(topic, "")))
        self._history = HistorySubscriber(session, latched, self._on_sample, refuse)
        self._drained: list[threading.Event] = []  # what had arrived before unsubscribing is taken
        self._subscribers, self._stack = ExitStack(), ExitStack()

    def __enter__(self) -> Self:
        with self._declared(self._selected) as subscribers, ExitStack() as stack:
            stack.enter_context(self._history)
            for topic, kind in self._topics.items():  # last: who sees it may publish
                stack.enter_context(self._keys.announced(self._session, topic, kind))
            self._subscribers, self._stack = subscribers.pop_all(), stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._subscribers.close()
        self._stack.close()

    def take_all(self) -> None:
        """Subscribe to all topics from now on, as a stream that is about to begin may have any."""
        if self._selected != self._keys.everything:
            self._selected, narrow = self._keys.everything, self._subscribers
            self._subscribers = self._declared(self._selected)
            narrow.close()

    def _declared(self, keys: Iterable[str]) -> ExitStack:
        """Declare subscribers, and return what undeclares them."""
        with ExitStack() as stack:
            for key in keys:
                self._drained.append(threading.Event())
                taking = zenoh.handlers.Callback(self._history.deliver, drop=self._drained[-1].set)
                remote = zenoh.Locality.REMOTE
                stack.enter_context(self._session.declare_subscriber(key, taking, allowed_origin=remote))
            return stack.pop_all()

    def close(self) -> None:
        """Receive no more, and wait until what has arrived is handed over."""
        self._subscribers.close()
        self._stack.close()
        deadline_s = time.monotonic() + _ALL_RECEIVED_WAIT_S
        for drained in self._drained:
            drained.wait(max(0.0, deadline_s - time.monotonic()))

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return  # a deleted key is no message
        key = str(sample.key_expr)
        try:
            topic = self._keys.read_key(key)
        except MessageError as error:
            self._refuse(key, str(error))
            return
        if len(sample.payload) > MAX_PAYLOAD:
            self._refuse(topic.sent_as, f"{len(sample.payload)} bytes, expected at most {MAX_PAYLOAD}")
            return
        try:
            self._take(topic, sample)
        except MessageError as error:
            self._refuse(topic.topic or topic.sent_as, str(error).removeprefix(f"{topic.topic}: "))

    def _take(self, topic: KeyedTopic, sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        if attachment is not None and len(attachment) > MAX_CONTROL:
            raise MessageError(f"{topic.topic}: an attachment of {len(attachment)} bytes")
        data = None if attachment is None else attachment.to_bytes()
        ours, origin = self._keys.read_attachment(topic.topic, data)
        if ours is not None and self._take_stream(topic, sample, ours):
            return
        if not topic.topic:
            raise MessageError("another topic has that name here, by --remap")
        if topic.topic in self._wanted and str(sample.key_expr) not in self._wanted[topic.topic]:
            raise MessageError("another type, or another definition of it")  # beside a stream, when all topics come
        received = Received(topic, sample, None, origin, self._arrival_ns(topic.topic, sample))
        self._hand_over(received if ours is None else received._replace(frame=self._framed(received, ours)))

    def _arrival_ns(self, topic: str, sample: zenoh.Sample) -> int:
        """Return the time [ns]; raises MessageError if there is none yet."""
        if self._sim_time is None:
            return time.time_ns()
        if topic == CLOCK:
            self._sim_time.take(sample.payload.to_bytes())
        if not self._sim_time.is_known:
            raise MessageError(NO_TIME)
        return self._sim_time.time_ns()

    def _framed(self, received: Received, attachment: bytes) -> Frame | None:
        """Return the frame that a sample is, None if its attachment is not ours.

        On the key of batches there are no others.
        """
        topic = received.topic.topic
        try:
            return unpack(topic, received.sample.payload.to_bytes(), attachment, type_name=received.type)
        except MessageError:
            if self._live and topic != batch_topic():
                return None
            raise


def live_messages(received: Received, keys: TopicKeys) -> Iterator[LiveMessage]:
    """Yield what a sample is when it is of no stream, under the names that this node has for the topics."""
    (topic, stated, sent_as, type_hash), sample, frame, origin, time_ns = received
    kind = received.type
    if frame is None:
        number = 0 if origin is None else origin.short_sequence
        record = RecordedMessage(topic, kind, sample.payload.to_bytes(), number, time_ns)
        found = LiveMessage(record, numbered=origin is not None, sent_as=sent_as, origin=origin, type_hash=type_hash)
        yield found if origin is None else found._replace(stamp=sample.timestamp)
        return
    is_batch = frame.kind is FrameType.BATCH
    stamp = None if origin is None else sample.timestamp
    for record in frame.messages:
        named = record._replace(
            topic=keys.received_as(record.topic) if is_batch else topic, type=stated or record.type or kind
        )
        name = record.topic if is_batch else sent_as
        yield LiveMessage(named, True, frame.run, frame.sender, name, origin, type_hash, stamp)


def schema_of(sample: zenoh.Sample) -> str:
    """Return the type that a sample's encoding names, such as `application/cdr;TYPE`, or an empty string."""
    encoding, _, schema = str(sample.encoding).partition(";")
    return schema if encoding in _ENCODINGS else ""
