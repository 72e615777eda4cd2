"""Frames on the data keys: single messages with their attachment, packed batches, the end and the abort."""

import re
import struct
from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

from recorders.errors import MessageError, WireError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.wire.stream import MAX_MESSAGE, PROTOCOL_VERSION

DEFAULT_NAMESPACE = "reenact"

MAX_PAYLOAD = MAX_MESSAGE + (1 << 16)
"""Larger payloads are refused unread [bytes]: a message, and its entry in a batch."""

_ATTACHMENT = struct.Struct("<BBxxI16s16sQQ")  # version, kind, sequence, run, sender, stream index, log time
_LIVE = struct.Struct("<4sI32sQQ")  # the same, with what all live messages share in two pieces
_CHUNK = r"(?!@)[^/*#?$\0\ud800-\udfff]+"  # no wildcard of Zenoh's, no control key of ours, and nothing but text
_TOPIC = re.compile(f"{_CHUNK}(/{_CHUNK})*")
_MAX_TOPIC = 1000  # characters; the length of a name in a batch has 16 bits
_RECORD = struct.Struct("<HIIQ")  # name length, data length, sequence, log time


NO_RUN = bytes(16)
"""The run of a live message: it belongs to no stream, and nobody acknowledges it."""


class FrameType(IntEnum):
    """The type of a frame's payload."""

    MESSAGE = 0  # one message; the payload is its CDR bytes, the key its topic
    BATCH = 1  # several messages, packed
    END = 2  # the stream ends at this index
    ABORT = 3  # the sender failed; the payload is the reason


_LIVE_HEAD = bytes([PROTOCOL_VERSION, FrameType.MESSAGE, 0, 0])
_NOBODY = NO_RUN + NO_RUN  # neither run nor sender


class Frame(NamedTuple):
    """One Zenoh sample of a stream: the index of its first message, and the messages it carries."""

    kind: FrameType
    run: bytes
    sender: bytes
    first: int
    messages: tuple[RecordedMessage, ...] = ()
    reason: str = ""

    @property
    def size(self) -> int:
        """Size of its messages [bytes]."""
        return sum(len(message.data) for message in self.messages)

    @property
    def end(self) -> int:
        """The stream index after this frame."""
        return self.first + len(self.messages)


def check_name(name: str) -> None:
    """Raise WireError unless a node's name can be part of a key."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,100}", name):
        raise WireError(f"name: expected letters, digits, '_', '.' or '-', found {name[:100]!r}")


def check_namespace(namespace: str) -> None:
    """Raise WireError unless a namespace can begin a key."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,100}(/[A-Za-z0-9_.-]{1,100})*", namespace):
        raise WireError(
            f"namespace: expected names with '/' between them, such as lab/asimo, found {namespace[:100]!r}"
        )


def batch_topic() -> str:
    """Return the name, as of a topic, of the key that batches, the end and the abort travel on."""
    return "/replay/batch"


def batch_key(namespace: str) -> str:
    """Return the key that batches, the end and the abort travel on."""
    return message_key(namespace, batch_topic())


def control_key(namespace: str, consumer: str, verb: str) -> str:
    """Return the key of a consumer's `hello`, `status` or `ack`."""
    return f"{namespace}/@consumer/{consumer}/{verb}"


@lru_cache(maxsize=1024)
def message_key(namespace: str, topic: str) -> str:
    """Return the key of a topic: the namespace and the topic without its leading slash.

    Raises
    ------
    WireError
        If the topic cannot be part of a key of its own: it would name several keys, or one of the protocol's.
    """
    name = topic.removeprefix("/")
    if len(name) > _MAX_TOPIC or not _TOPIC.fullmatch(name):
        raise WireError(
            "topic: expected names with '/' between them, such as /hand/left/target, without any of * # ? $, "
            f"of at most {_MAX_TOPIC} characters and none that begins with @, found {topic[:100]!r}"
        )
    return f"{namespace}/{name}"


def pack(frame: Frame) -> tuple[bytes, bytes]:
    """Return (payload, attachment) of a frame."""
    sequence, log_time_ns, payload = 0, 0, b""
    if frame.kind is FrameType.MESSAGE:
        (message,) = frame.messages
        sequence, log_time_ns, payload = message.sequence, message.log_time_ns, message.data
    elif frame.kind is FrameType.BATCH:
        payload = _pack_messages(frame.messages)
    elif frame.kind is FrameType.ABORT:
        payload = frame.reason.encode()
    attachment = _ATTACHMENT.pack(
        PROTOCOL_VERSION, frame.kind, sequence, frame.run, frame.sender, frame.first, log_time_ns
    )
    return payload, attachment


def live_attachment(sequence: int, log_time_ns: int) -> bytes:
    """Return the attachment that `pack` gives a message of no run, numbered from 0, with its log time [ns]."""
    return _LIVE.pack(_LIVE_HEAD, sequence, _NOBODY, sequence, log_time_ns)


def unpack(topic: str, payload: bytes, attachment: bytes) -> Frame:
    """Read a frame back.

    Parameters
    ----------
    topic : str
        Topic of the key that the sample came on; only a single message has one.

    Raises
    ------
    MessageError
        If attachment or payload are not what `pack` makes.
    """
    try:
        version, kind, sequence, run, sender, index, log_time_ns = _ATTACHMENT.unpack(attachment)
        frame = Frame(FrameType(kind), run, sender, index)
        if version != PROTOCOL_VERSION:
            raise MessageError(f"{topic}: expected protocol version {PROTOCOL_VERSION}, found {version}")
        if frame.kind is FrameType.MESSAGE:
            return frame._replace(messages=(RecordedMessage(topic, type_of(topic), payload, sequence, log_time_ns),))
        if frame.kind is FrameType.BATCH:
            return frame._replace(messages=_unpack_messages(payload))
        return frame._replace(reason=payload.decode(errors="replace"))
    except (struct.error, ValueError) as error:
        raise MessageError(f"{topic}: {len(payload)} bytes that are no frame of a replay ({error})") from error


def _pack_messages(messages: Sequence[RecordedMessage]) -> bytes:
    parts: list[bytes] = []
    for topic, kind, data, sequence, log_time_ns in messages:
        name = _name(topic, kind)
        parts += (_RECORD.pack(len(name), len(data), sequence, log_time_ns), name, data)
    return b"".join(parts)


def _unpack_messages(payload: bytes) -> tuple[RecordedMessage, ...]:
    messages, place = [], 0
    while place < len(payload):
        name_length, data_length, sequence, log_time_ns = _RECORD.unpack_from(payload, place)
        name_at = place + _RECORD.size
        data_at = name_at + name_length
        place = data_at + data_length
        if place > len(payload):
            raise ValueError(f"a record of {data_length} bytes overruns the payload")
        topic, kind = _topic_and_type(payload[name_at:data_at])
        messages.append(RecordedMessage(topic, kind, payload[data_at:place], sequence, log_time_ns))
    return tuple(messages)


def _name(topic: str, kind: str) -> bytes:
    """Return the topic, and its type behind a NUL where it is not the one in the table of topics."""
    return topic.encode() if kind == type_of(topic) else f"{topic}\0{kind}".encode()


@lru_cache(maxsize=1024)
def _topic_and_type(name: bytes) -> tuple[str, str]:
    topic, _, kind = name.decode().partition("\0")
    return topic, kind or type_of(topic)
