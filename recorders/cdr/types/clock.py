"""rosgraph_msgs/msg/Clock."""

from recorders.cdr.message_format import MessageFormat
from recorders.messages.message_types import Clock

FORMAT = MessageFormat(
    Clock,
    read=lambda reader: Clock(reader.time_ns()),
    write=lambda writer, message: writer.time_ns(message.clock_ns),
    fields=lambda message: [("clock", message.clock_ns)],
    parts=("clock",),
)
