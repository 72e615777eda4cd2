"""Subscribes to everything under a namespace, and reads each sample as a frame of a stream or as a live message."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from typing import NamedTuple, Self, TypeAlias

import zenoh

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.protocol.frames import MAX_PAYLOAD, NO_RUN, Frame, batch_topic, unpack
from recorders.wire.history import HistorySubscriber
from recorders.wire.keys.namespace import message_key
from recorders.wire.queries import MAX_CONTROL

_ENCODINGS = frozenset(map(str, (zenoh.Encoding.APPLICATION_CDR, zenoh.Encoding.APPLICATION_OCTET_STREAM)))
_ALL_RECEIVED_WAIT_S = 10.0  # Zenoh hands over what it holds within milliseconds


class LiveMessage(NamedTuple):
    """A message of nobody's stream; without a number of its producer's, its sequence is 0.

    A replay that does not await this consumer is received so, too: then `sender` identifies it.
    """

    record: RecordedMessage
    numbered: bool
    sender: bytes = NO_RUN


HandOver: TypeAlias = Callable[[str, zenoh.Sample, Frame | None], None]
"""Takes a topic, the sample that came on it, and the frame that it is; None if it has no attachment of ours."""

TakeStream: TypeAlias = Callable[[str, zenoh.Sample, bytes], bool]
"""Takes a topic, a sample and its attachment; False if they are of no stream that anybody here awaits."""


class Subscription:
    """A subscription to all topics of a namespace, and to what publishers cache of some of them.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    namespace : str
        First part of every key.
    hand_over : callable
        Takes what is received, on threads of Zenoh's.
    refuse : callable
        Takes topic and reason of what is neither a message nor a frame.
    latched_topics : iterable of str
        Topics of which the last message from before this came is received too, if its publisher caches it.
    live : bool
        Whether attachments of others are passed over: they may attach to live messages what they like.
    take_stream : callable
        Takes what is of a stream, before anything else looks at it; raises MessageError to refuse it.
    """

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str,
        *,
        hand_over: HandOver,
        refuse: Callable[[str, str], None],
        latched_topics: Iterable[str] = (),
        live: bool = False,
        take_stream: TakeStream = lambda topic, sample, attachment: False,
    ) -> None:
        self._session = session
        self._namespace = namespace
        self._hand_over = hand_over
        self._refuse = refuse
        self._live = live
        self._take_stream = take_stream
        latched = (message_key(namespace, topic) for topic in latched_topics)
        self._history = HistorySubscriber(session, latched, self._on_sample)
        self._all_received = threading.Event()  # whatever had arrived before unsubscribing is handed over
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        subscriber = self._session.declare_subscriber(
            f"{self._namespace}/**",
            zenoh.handlers.Callback(self._history.deliver, drop=self._all_received.set),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._stack.enter_context(subscriber)
        self._stack.enter_context(self._history)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def close(self) -> None:
        """Receive no more, and wait until what has arrived is handed over."""
        self._stack.close()
        self._all_received.wait(_ALL_RECEIVED_WAIT_S)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return  # a deleted key is no message
        topic = "/" + str(sample.key_expr).removeprefix(self._namespace + "/")
        if len(sample.payload) > MAX_PAYLOAD:
            self._refuse(topic, f"{len(sample.payload)} bytes, expected at most {MAX_PAYLOAD}")
            return
        try:
            self._take(topic, sample)
        except MessageError as error:
            self._refuse(topic, str(error).removeprefix(f"{topic}: "))

    def _take(self, topic: str, sample: zenoh.Sample) -> None:
        if sample.attachment is None:
            self._hand_over(topic, sample, None)
            return
        if len(sample.attachment) > MAX_CONTROL:
            raise MessageError(f"{topic}: an attachment of {len(sample.attachment)} bytes")
        attachment = sample.attachment.to_bytes()
        if not self._take_stream(topic, sample, attachment):
            self._hand_over(topic, sample, self._framed(topic, sample, attachment))

    def _framed(self, topic: str, sample: zenoh.Sample, attachment: bytes) -> Frame | None:
        """Return the frame that a sample is, None if its attachment is not ours.

        On the key of batches there are no others.
        """
        try:
            return unpack(topic, sample.payload.to_bytes(), attachment, type_name=schema_of(sample))
        except MessageError:
            if self._live and topic != batch_topic():
                return None
            raise


def live_messages(topic: str, sample: zenoh.Sample, frame: Frame | None) -> Iterator[LiveMessage]:
    """Yield what a sample is when it is of no stream; the arguments are those of `HandOver`."""
    kind = type_of(topic) or schema_of(sample)
    if frame is None:
        record = RecordedMessage(topic, kind, sample.payload.to_bytes(), 0, time.time_ns())
        yield LiveMessage(record, numbered=False)
        return
    for record in frame.messages:
        yield LiveMessage(record._replace(type=record.type or kind), numbered=True, sender=frame.sender)


def schema_of(sample: zenoh.Sample) -> str:
    """Return the type that a sample's encoding names, such as `application/cdr;TYPE`, or an empty string."""
    encoding, _, schema = str(sample.encoding).partition(";")
    return schema if encoding in _ENCODINGS else ""
