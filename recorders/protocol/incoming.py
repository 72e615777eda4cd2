"""One stream as it comes in: its frames opened, put in order, and counted towards acknowledgement and digest."""

from typing import Any

from recorders.errors import MessageError
from recorders.protocol.frames import Frame, FrameType, unpack
from recorders.protocol.packets import Packet
from recorders.protocol.seals.sealing import ReceiverSeals
from recorders.protocol.stream import Offer, Progress, is_acknowledged
from recorders.protocol.stream_digest import StreamDigest, find_digest
from recorders.text.wording import escape_control

MAX_REASON = 1000
"""How much of what a sender gives as its reason is taken over [characters]."""


class IncomingStream:
    """A stream that a consumer has accepted.

    Parameters
    ----------
    offer : Offer
        The stream.
    seals : ReceiverSeals
        Checks what its sender sends, and seals what goes there.
    start : int
        Stream index of the first message that the consumer wants.

    Attributes
    ----------
    result : dict, optional
        What the consumer made of all of it.
    error : str, optional
        Why the consumer stopped.
    given_up : str
        Why the sender gave it up before the consumer had decided; empty if it did not.
    """

    def __init__(self, offer: Offer, seals: ReceiverSeals, start: int) -> None:
        self.offer, self.seals = offer, seals
        self.identity = offer.identity
        self._start = self._next = self._received = self._acknowledged = start
        self._consumed_bytes = 0  # since the last acknowledgement
        self._digest = StreamDigest(start)
        self._looked_at: tuple[Frame | None, bytes] = None, b""  # what is new, and as it travels if all of it is
        self._has_end = False
        self._newest = -1
        self.result: dict[str, Any] | None = None
        self.error: str | None = None
        self.given_up = ""

    @property
    def progress(self) -> Progress:
        """How far it has come; with the digest of what arrived, beside a result."""
        digest = None if self.result is None else self._digest.digest().hex()
        return Progress(self.offer.run, self._next, self._received, self.result, self.error, digest)

    @property
    def beginning(self) -> Progress:
        """The answer to its offer, however late and often: where it began, as both ends digest it from there on."""
        return self.progress if self.is_final else Progress(self.offer.run, self._start, self._start)

    @property
    def is_final(self) -> bool:
        """Whether the consumer is through with it: it has a result, or stopped."""
        return self.result is not None or self.error is not None

    def is_news(self, number: int) -> bool:
        """Whether the sender has sealed a packet later than all that were known: one that is repeated shows no life."""
        is_news = number > self._newest
        self._newest = max(self._newest, number)
        return is_news

    def opened(self, topic: str, packet: Packet, type_name: str) -> tuple[Frame, int]:
        """Return a frame and the number of its seal.

        Raises
        ------
        MessageError
            If it is not the sender's, or no frame.
        """
        number = self.seals.frame_number(topic, packet, type_name)
        if number is None:
            raise MessageError(f"{topic}: a frame of the stream that is under way, but not sealed by its sender")
        return unpack(topic, *packet, type_name=type_name), number

    def aborted(self, frame: Frame) -> str:
        """Return in words why the sender has given the stream up, from its abort."""
        return escape_control(f"the sender gave up at message {self._received}: {frame.reason[:MAX_REASON]}")

    def note_abort(self, topic: str, packet: Packet, type_name: str) -> None:
        """Note if the sender gives the stream up before it has begun; raises as `opened` does."""
        frame, _ = self.opened(topic, packet, type_name)
        if frame.kind is FrameType.ABORT:
            self.given_up = self.aborted(frame)

    def new_part(self, frame: Frame, payload: bytes) -> Frame | None:
        """Return what is new of a frame: what came before is a repeat, what comes after a gap is sent again.

        An end after which other messages have arrived than were sent comes as the reason to give the stream up. One
        without a digest from where this consumer began is of before its sender knew of that: another will come.
        """
        received = self._received
        is_end = frame.kind is FrameType.END and not self._has_end and frame.first == received
        if frame.first > received or not (frame.end > received or is_end):
            return None
        if is_end and (sent := find_digest(frame.digests, self._start)) != self._digest.digest().hex():
            if not sent:
                return None
            reason = f"what arrived up to message {received} is not what was sent: nothing of it is to be trusted"
            return frame._replace(kind=FrameType.ABORT, reason=reason)
        if frame.first < received:
            frame, payload = frame.from_index(received), b""
        self._looked_at = frame, payload if frame.kind is FrameType.BATCH else b""
        return frame

    def arrived(self, frame: Frame) -> None:
        """Note that what `new_part` returned is queued."""
        looked_at, packed = self._looked_at
        self._digest.add(frame, packed if looked_at is frame else b"")
        self._has_end = frame.kind is FrameType.END
        self._received = frame.end

    def consume(self, frame: Frame) -> bool:
        """Note that a frame's messages are consumed; True if an acknowledgement is due."""
        self._next = frame.end
        self._consumed_bytes += frame.size
        if not is_acknowledged(frame.end - self._acknowledged, self._consumed_bytes, self.offer.window):
            return False
        self._acknowledged, self._consumed_bytes = frame.end, 0
        return True
