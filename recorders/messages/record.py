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
