"""Packs what a sender publishes and asks, and keeps it until whoever drives the sender has seen to it."""

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import MAX_PAYLOAD, Frame, FrameType, batch_topic, pack
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.stream import Offer


class Outbox:
    """What a sender wants done and has not been done yet.

    Parameters
    ----------
    offer : Offer
        The stream.
    """

    def __init__(self, offer: Offer) -> None:
        self._offer = offer
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
        frame = Frame(kind, *self._offer.identity, first, messages, reason)
        self.publish_again(frame)
        return frame

    def publish_again(self, frame: Frame) -> None:
        """Have a frame published that was published before."""
        packet = Packet(*pack(frame))
        if len(packet.payload) > MAX_PAYLOAD:
            topic = frame.messages[0].topic
            raise WireError(f"{topic}: expected at most {MAX_PAYLOAD} bytes in a message, found {len(packet.payload)}")
        topic = frame.messages[0].topic if frame.kind is FrameType.MESSAGE else batch_topic()
        self._actions.append(Publish(topic, packet, frame))

    def ask(self, ask: Ask) -> None:
        """Have a consumer asked."""
        self._actions.append(ask)
