"""Reads the samples of a served controller's topics: their types and their numbers."""

import zenoh

from pipeline.serving.background_writer import UNNUMBERED
from recorders.errors import MessageError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import type_of
from recorders.protocol.frames import unpack
from recorders.wire.keys.topic_keys import TopicKeys

MAX_PAYLOAD = 64 << 10
"""Larger payloads are refused unread [bytes]; a pose takes some 100, the joints of a large robot a few thousand."""

CDR = "application/cdr;"
"""How the encoding of a typed message begins."""


class TopicReader:
    """Types of the samples of a topic; remembers the last encoding, which is nearly always the next.

    Parameters
    ----------
    topic : str
        Without an encoding that names a type, a sample is of this topic's.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._encoding = zenoh.Encoding.ZENOH_BYTES
        self._type = type_of(topic)

    def type_name(self, encoding: zenoh.Encoding) -> str:
        """Return the name of a sample's type."""
        if encoding != self._encoding:
            text = str(encoding)
            self._type = text[len(CDR) :] if text.startswith(CDR) else type_of(self.topic)
            self._encoding = encoding
        return self._type

    def pose(self, sample: zenoh.Sample) -> bytes:
        """Return the payload of a sample that may be a usual pose; nothing if it is none, nor is what was deleted."""
        payload = sample.payload
        usual = len(payload) <= MAX_PAYLOAD and self.type_name(sample.encoding) == PoseStamped.TYPE
        return payload.to_bytes() if usual else b""


Arrival = tuple[TopicReader, zenoh.Sample, int]
"""A sample, with the reader of its topic, and when it came [ns]."""


def sequence_of(keys: TopicKeys, topic: str, sample: zenoh.Sample) -> int:
    """Return the producer's number, if an attachment of ours or of rmw_zenoh carries one."""
    if sample.attachment is None or len(sample.attachment) > MAX_PAYLOAD:
        return UNNUMBERED
    try:
        ours, origin = keys.read_attachment(topic, sample.attachment.to_bytes())
        if ours is None:
            return UNNUMBERED if origin is None else origin.short_sequence
        messages = unpack(topic, b"", ours).messages
    except MessageError:
        return UNNUMBERED
    return messages[0].sequence if messages else UNNUMBERED
