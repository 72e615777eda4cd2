"""One record of a log as it travels: topic, type, undecoded bytes, and the numbers that go with them."""

from typing import NamedTuple


class RecordedMessage(NamedTuple):
    """A message as recorded, not decoded: the same bytes in the log and on the wire.

    Attributes
    ----------
    topic : str
        ROS topic name, with its leading slash.
    type : str
        ROS 2 type name, such as `sensor_msgs/msg/JointState`; for a foreign log whatever its schema is called.
    data : bytes
        The message itself, CDR in our logs.
    sequence : int
        The producer's number, gap-free per topic.
    log_time_ns : int
        Time of recording [ns]; the producer's time is in the message's header.
    """

    topic: str
    type: str
    data: bytes
    sequence: int
    log_time_ns: int


class PublishedMessage(RecordedMessage):
    """A message whose publish time in the log is another than its log time, for who asks for it: else the same.

    Attributes
    ----------
    publish_time_ns : int
        Time of publication [ns], by its recorder.
    """

    publish_time_ns: int


def published(record: RecordedMessage, publish_time_ns: int) -> RecordedMessage:
    """Return a message with its publish time [ns]; as it is if that is its log time."""
    if publish_time_ns == record.log_time_ns:
        return record
    found = PublishedMessage(*record)
    found.publish_time_ns = publish_time_ns
    return found


def publish_time_ns(record: RecordedMessage) -> int:
    """Return the publish time of a message [ns]: its log time if no other is known."""
    return record.publish_time_ns if isinstance(record, PublishedMessage) else record.log_time_ns
