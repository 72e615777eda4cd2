"""A stream whose messages differ, on three topics of the learner's in turn, some of them empty."""

from collections.abc import Iterator

from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS
from recorders.protocol.stream import Offer

OFFER = Offer(run="ab" * 16, schedule={}, logs=[])


def message(index: int) -> RecordedMessage:
    topic = LEARNER_TOPICS[index % 3]
    return RecordedMessage(topic.name, topic.type, f"payload {index}".encode() * (index % 7), index, index * 1_000)


def numbered(start: int, count: int) -> Iterator[RecordedMessage]:
    """Yield the messages from an index on, of so many."""
    return (message(index) for index in range(start, count))
