"""Packets that travel, and what a sender wants done: publish one, or ask a consumer with one."""

from typing import NamedTuple, TypeAlias

from recorders.errors import WireError
from recorders.protocol.frames import Frame
from recorders.protocol.stream import Progress


class Packet(NamedTuple):
    """What travels: a payload, and the bytes attached to it."""

    payload: bytes
    attachment: bytes = b""


class Publish(NamedTuple):
    """To be published on the key of a topic, for all consumers; the frame is what the packet holds."""

    topic: str
    packet: Packet
    frame: Frame


class Ask(NamedTuple):
    """To be asked of one consumer: its `hello` or its `status`, with the time that the answer may take [s]."""

    number: int
    consumer: str
    verb: str
    packet: Packet
    timeout_s: float


Action: TypeAlias = Publish | Ask


def read_progress(packet: Packet) -> Progress | None:
    """Return the progress that a packet holds; None if it holds none."""
    try:
        return Progress.from_json(packet.payload)
    except WireError:
        return None
