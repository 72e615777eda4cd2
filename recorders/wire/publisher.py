"""Publishes a node's messages on the keys of their topics, numbered gap-free per topic."""

import secrets
from collections import Counter
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import zenoh

from recorders.cdr.codec import encode
from recorders.messages.message_types import TypedMessage
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import NO_RUN, Frame, FrameType, pack
from recorders.wire.keys.topic_keys import MessagePublisher, NamespaceKeys, TopicKeys

_IDENTITY_BYTES = 16


def new_identity() -> bytes:
    """Return 16 random bytes by which the numbers of one publisher are distinguished from those of others."""
    return secrets.token_bytes(_IDENTITY_BYTES)


class TopicPublisher:
    """The publishing end of a live node: a robot, a learner, a served controller.

    Nobody acknowledges these messages; a subscriber that falls behind can lose some, and sees so by their numbers.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : TopicKeys, optional
        Keys of the topics; those of the default namespace if left out.

    Attributes
    ----------
    published : int
        How many messages it has published.
    identity : bytes
        What distinguishes its numbers from those of others.
    """

    def __init__(self, session: zenoh.Session, *, keys: TopicKeys | None = None) -> None:
        self._session = session
        self._keys = keys or NamespaceKeys()
        self._publishers: dict[str, MessagePublisher] = {}
        self._numbered: Counter[str] = Counter()
        self.published = 0
        self.identity = new_identity()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def publish(self, topic: str, message: TypedMessage, *, log_time_ns: int) -> RecordedMessage:
        """Publish one message and return it as it went out.

        Parameters
        ----------
        topic : str
            ROS topic name.
        message : Message
            The message.
        log_time_ns : int
            The producer's time [ns], for whoever records.
        """
        record = RecordedMessage(topic, message.TYPE, encode(message), self._numbered[topic], log_time_ns)
        payload, attachment = pack(Frame(FrameType.MESSAGE, NO_RUN, self.identity, self.published, (record,)))
        self._publisher(topic, message.TYPE).put(payload, attachment=attachment)
        self._numbered[topic] += 1
        self.published += 1
        return record

    def _publisher(self, topic: str, type_name: str) -> MessagePublisher:
        if topic not in self._publishers:
            publisher = self._keys.publishing(
                self._session,
                topic,
                type_name,
                encoding=f"application/cdr;{type_name}",  # by which a recorder knows the type of a topic of your own
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            self._publishers[topic] = self._stack.enter_context(publisher)
        return self._publishers[topic]
