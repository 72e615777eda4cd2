"""Messages of `/clock` between those of a stream: the log time as it passes, for nodes that go by it."""

from collections.abc import Iterator

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import Clock
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK

CLOCK_CHANNEL = DeclaredChannel(CLOCK, "cdr", schema=(Clock.TYPE, "ros2msg", schema_text(Clock.TYPE).encode()))
"""The channel of these messages."""


def with_clock(stream: Iterator[RecordedMessage], period_ns: int) -> Iterator[RecordedMessage]:
    """Yield a stream with a clock message at every multiple of a period, each before what is as late or later.

    The first one is at or before the first message, so that no message comes to a node that has no time. Where times
    fall, as a stream begins anew, the clock does too.

    Parameters
    ----------
    stream : iterator of RecordedMessage
        The stream; none of it is of `/clock`.
    period_ns : int
        The period [ns] of log time.

    Yields
    ------
    RecordedMessage
        The messages.

    Raises
    ------
    MessageError
        If a log time is beyond what a message of ROS 2 can hold.
    """
    number, last_ns = 0, -1
    for message in stream:
        time_ns = message.log_time_ns
        if last_ns < 0 or time_ns < last_ns:
            due_ns = time_ns - time_ns % period_ns
        while due_ns <= time_ns:
            yield RecordedMessage(CLOCK, Clock.TYPE, encode(Clock(due_ns)), number, due_ns)
            number, due_ns = number + 1, due_ns + period_ns
        last_ns = time_ns
        yield message
