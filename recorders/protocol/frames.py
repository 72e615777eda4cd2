"""Frames on the data keys: single messages with their attachment, packed batches, the end and the abort."""

import struct
from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache
from operator import itemgetter
from typing import NamedTuple, Self

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.protocol.stream import MAX_MESSAGE, PROTOCOL_VERSION

MAX_PAYLOAD = MAX_MESSAGE + (1 << 16)
"""Larger payloads are refused unread [bytes]: a message, and its entry in a batch."""

_ATTACHMENT = struct.Struct("<BBxxI16s16sQQ")  # version, kind, sequence, run, sender, stream index, log time
ATTACHMENT_BYTES = _ATTACHMENT.size
"""Size of what is attached to a frame [bytes]; its seal comes behind that."""

SEAL_BYTES = 24
"""Size of a seal [bytes]."""

_RUN, _SENDER = slice(8, 24), slice(24, 40)
_LIVE = struct.Struct("<4sI16s16sQQ")  # the same, with what all live messages share in one piece
_RECORD = struct.Struct("<HIIQ")  # name length, data length, sequence, log time
_RECORD_BYTES = _RECORD.size
_DATA = itemgetter(RecordedMessage._fields.index("data"))


NO_RUN = bytes(16)
"""The run of a live message: it belongs to no stream, and nobody acknowledges it. As a sender: nobody in particular."""


class FrameType(IntEnum):
    """The type of a frame's payload."""

    MESSAGE = 0  # one message; the payload is its CDR bytes, the key its topic
    BATCH = 1  # several messages, packed
    END = 2  # the stream ends at this index
    ABORT = 3  # the sender failed; the payload is the reason


_LIVE_HEAD = bytes([PROTOCOL_VERSION, FrameType.MESSAGE, 0, 0])


class Frame(NamedTuple):
    """One Zenoh sample of a stream: the index of its first message, and the messages it carries.

    A live message is of no run, and its sender the publisher that has numbered it.
    """

    kind: FrameType
    run: bytes
    sender: bytes
    first: int
    messages: tuple[RecordedMessage, ...] = ()
    reason: str = ""
    digests: bytes = b""  # of the whole stream, with its end

    @property
    def size(self) -> int:
        """Size of its messages [bytes]."""
        return size_of(self.messages)

    @property
    def end(self) -> int:
        """The stream index after this frame."""
        return self.first + len(self.messages)

    def from_index(self, index: int) -> Self:
        """Return the part of this frame from a stream index on, which lies in it."""
        return self._replace(first=index, messages=self.messages[index - self.first :])


def size_of(messages: Sequence[RecordedMessage]) -> int:
    """Return the size of some messages [bytes], as bounds count it."""
    return sum(map(len, map(_DATA, messages)))


def batch_topic() -> str:
    """Return the name, as of a topic, of the key that batches, the end and the abort travel on."""
    return "/replay/batch"


def pack(frame: Frame) -> tuple[bytes, bytes]:
    """Return (payload, attachment) of a frame."""
    sequence, log_time_ns = 0, 0
    if frame.kind is FrameType.MESSAGE:
        (message,) = frame.messages
        sequence, log_time_ns, payload = message.sequence, message.log_time_ns, message.data
    elif frame.kind is FrameType.BATCH:
        payload = records(frame.messages)
    else:
        payload = frame.digests or frame.reason.encode()
    attachment = _ATTACHMENT.pack(
        PROTOCOL_VERSION, frame.kind, sequence, frame.run, frame.sender, frame.first, log_time_ns
    )
    return payload, attachment


def live_attachment(sequence: int, log_time_ns: int, publisher: bytes = NO_RUN) -> bytes:
    """Return the attachment that `pack` gives a message of no run, numbered from 0, with its log time [ns].

    The 16 bytes of the publisher distinguish its numbers from those of others on the same topic.
    """
    return _LIVE.pack(_LIVE_HEAD, sequence, NO_RUN, publisher, sequence, log_time_ns)


def stream_of(attachment: bytes) -> tuple[bytes, bytes] | None:
    """Return the run and the sender that a sealed attachment names; None if it is not one of a frame."""
    return (attachment[_RUN], attachment[_SENDER]) if len(attachment) == ATTACHMENT_BYTES + SEAL_BYTES else None


def unpack(topic: str, payload: bytes, attachment: bytes, *, type_name: str = "") -> Frame:
    """Read a frame back.

    Parameters
    ----------
    topic : str
        Topic of the key that the sample came on; only a single message has one.
    payload, attachment : bytes
        As `pack` returns them; the attachment may be sealed, which is not looked at.
    type_name : str
        Type of a single message on a topic of which none is known.

    Raises
    ------
    MessageError
        If attachment or payload are not what `pack` makes.
    """
    try:
        body = attachment[:ATTACHMENT_BYTES] if stream_of(attachment) else attachment
        version, number, sequence, run, sender, index, log_time_ns = _ATTACHMENT.unpack(body)
        kind = FrameType(number)
        if version != PROTOCOL_VERSION:
            raise MessageError(f"{topic}: expected protocol version {PROTOCOL_VERSION}, found {version}")
        if kind is FrameType.MESSAGE:
            message = RecordedMessage(topic, type_of(topic) or type_name, payload, sequence, log_time_ns)
            return Frame(kind, run, sender, index, (message,))
        if kind is FrameType.BATCH:
            return Frame(kind, run, sender, index, _unpack_messages(payload))
        if kind is FrameType.END:
            return Frame(kind, run, sender, index, digests=payload)
        return Frame(kind, run, sender, index, reason=payload.decode(errors="replace"))
    except (struct.error, ValueError) as error:
        raise MessageError(f"{topic}: {len(payload)} bytes that are no frame of a replay ({error})") from error


def records(messages: Sequence[RecordedMessage]) -> bytes:
    """Return messages as a batch of them travels."""
    parts: list[bytes] = []
    for topic, kind, data, sequence, log_time_ns in messages:
        name = _name(topic, kind)
        parts += (_RECORD.pack(len(name), len(data), sequence, log_time_ns), name, data)
    return b"".join(parts)


def _unpack_messages(payload: bytes) -> tuple[RecordedMessage, ...]:
    messages, place, size, head, new = [], 0, len(payload), _RECORD.unpack_from, tuple.__new__
    while place < size:
        name_length, data_length, sequence, log_time_ns = head(payload, place)
        name_at = place + _RECORD_BYTES
        data_at = name_at + name_length
        place = data_at + data_length
        if place > size:
            raise ValueError(f"a record of {data_length} bytes overruns the payload")
        topic, kind = _topic_and_type(payload[name_at:data_at])
        # Past the constructor that Python writes for a named tuple, which takes a third of the time.
        messages.append(new(RecordedMessage, (topic, kind, payload[data_at:place], sequence, log_time_ns)))
    return tuple(messages)


@lru_cache(maxsize=1024)
def _name(topic: str, kind: str) -> bytes:
    """Return the topic, and its type behind a NUL where it is not the one in the table of topics."""
    return topic.encode() if kind == type_of(topic) else f"{topic}\0{kind}".encode()


@lru_cache(maxsize=1024)
def _topic_and_type(name: bytes) -> tuple[str, str]:
    topic, _, kind = name.decode().partition("\0")
    return topic, kind or type_of(topic)
