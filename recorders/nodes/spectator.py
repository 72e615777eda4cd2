"""Messages of all topics as they come, for whoever looks on: nobody waits for it, and it may miss some."""

from collections.abc import Callable, Iterator

import zenoh

from recorders.messages.record import RecordedMessage
from recorders.wire.bounded_queue import BoundedQueue
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.subscription import Received, Subscription, live_messages

_WAITING_BYTES = 2**26
_LOOK_S = 0.2  # how often it is seen whether it is over


def watched(
    session: zenoh.Session, keys: TopicKeys, *, stopped: Callable[[], bool], on_missed: Callable[[int], None]
) -> Iterator[RecordedMessage]:
    """Yield every message that is published, live or in a replay, until it is over.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : TopicKeys
        Keys of the topics.
    stopped : callable
        Whether it is over.
    on_missed : callable
        Takes how many messages were missed, as they came faster than they were taken.
    """
    waiting: BoundedQueue[Received] = BoundedQueue(limit=_WAITING_BYTES)

    def take(received: Received) -> None:
        """Queue a sample, on a thread of Zenoh's."""
        waiting.put(received, len(received.sample.payload))

    with Subscription(session, keys, hand_over=take, refuse=lambda topic, reason: None, live=True):
        while not stopped():
            found = waiting.get(_LOOK_S)
            if missed := waiting.take_dropped():
                on_missed(missed)
            if found is not None:
                for message in live_messages(found, keys):
                    yield message.record
