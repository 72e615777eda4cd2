"""Packs and seals what a sender publishes and asks, and keeps it until whoever drives the sender has seen to it."""

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import MAX_PAYLOAD, Frame, FrameType, batch_topic, pack
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.seals.sealing import SenderSeals
from recorders.protocol.stream import Offer
from recorders.protocol.stream_digest import StreamDigests


class Outbox:
    """What a sender wants done and has not been done yet.

    Parameters
    ----------
    offer : Offer
        The stream.
    seals : SenderSeals
        Seals everything.

    Attributes
    ----------
    digests : StreamDigests
        Of everything that was published, from where each consumer takes it.
    """

    def __init__(self, offer: Offer, seals: SenderSeals) -> None:
        self._offer = offer
        self._seals = seals
        self.digests = StreamDigests()
        self._actions: list[Action] = []

    def __len__(self) -> int:
        return len(self._actions)

    def take(self) -> list[Action]:
        """Return what is to be done, in this order, and forget it."""
        actions, self._actions = self._actions, []
        return actions

    def publish(
        self, kind: FrameType, first: int, messages: tuple[RecordedMessage, ...] = (), reason: str = ""
    ) -> Frame:
        """Have a frame published that begins at a stream index, and return it.

        Raises
        ------
        WireError
            If a message is larger than anybody receives.
        """
        digests = self.digests.packed() if kind is FrameType.END else b""
        frame = Frame(kind, *self._offer.identity, first, messages, reason, digests)
        payload = self.publish_again(frame)
        self.digests.add(frame, payload if kind is FrameType.BATCH else b"")
        return frame

    def publish_again(self, frame: Frame) -> bytes:
        """Have a frame published that was published before, and return its payload."""
        packet = Packet(*pack(frame))
        if len(packet.payload) > MAX_PAYLOAD:
            topic = frame.messages[0].topic
            raise WireError(f"{topic}: expected at most {MAX_PAYLOAD} bytes in a message, found {len(packet.payload)}")
        single = frame.kind is FrameType.MESSAGE
        topic, kind = (frame.messages[0].topic, frame.messages[0].type) if single else (batch_topic(), "")
        self._actions.append(Publish(topic, self._seals.frame(topic, packet, kind), frame))
        return packet.payload

    def ask(self, ask: Ask) -> None:
        """Have a consumer asked."""
        self._actions.append(ask)
