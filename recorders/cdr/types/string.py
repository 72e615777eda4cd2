"""std_msgs/msg/String."""

from recorders.cdr.message_format import MessageFormat
from recorders.messages.message_types import String

FORMAT = MessageFormat(
    String,
    read=lambda reader: String(reader.string()),
    write=lambda writer, message: writer.string(message.data),
    fields=lambda message: [("data", message.data)],
    parts=("data",),
)
