"""Answers of a receiver to offers and to questions how far it is, by what it knows of streams; they change nothing."""

from collections.abc import Callable
from typing import NamedTuple

from recorders.errors import WireError
from recorders.protocol.known_streams import KnownStreams
from recorders.protocol.packets import Packet
from recorders.protocol.seals.sealing import ConsumerKeys, ReceiverSeals
from recorders.protocol.stream import Offer, Progress, asker, is_identifier

_NOT_SEALED = "not sealed with the key of this consumer: start both ends with the same --key FILE"


class Offered(NamedTuple):
    """A stream on offer that the consumer is to accept or to refuse."""

    offer: Offer
    question: Packet  # as it came
    seals: ReceiverSeals

    @property
    def size(self) -> int:
        """Size as it came [bytes]."""
        return len(self.question.payload)

    def answer(self, progress: Progress) -> Packet:
        """Return an answer to the offer."""
        return self.seals.answer(self.question, progress.to_json())


class Answers:
    """Answers for one consumer.

    Parameters
    ----------
    keys : ConsumerKeys
        Makes the seals for each sender.
    streams : KnownStreams
        What the consumer knows of streams.
    refuse : callable
        Takes what it was and why, of what is not authentic.
    """

    def __init__(self, keys: ConsumerKeys, streams: KnownStreams, refuse: Callable[[str, str], None]) -> None:
        self._keys = keys
        self._streams = streams
        self._refuse = refuse

    def to_hello(self, packet: Packet, taken: str) -> Packet | Offered:
        """Return the answer to an offer, or a new one, which is to be accepted or refused."""
        try:
            offer = Offer.from_json(packet.payload)
        except WireError as error:
            return Packet(Progress(error=str(error)).to_json())
        offered = Offered(offer, packet, self._keys.seals(offer.identity[1]))
        if offered.seals.question_number("hello", packet) is None:
            self._refuse("hello", f"an offer that is {_NOT_SEALED}")
            return Packet(Progress(error=f"the offer is {_NOT_SEALED}").to_json())
        if not self._keys.is_for_this(packet):
            return offered.answer(Progress())  # it is to be offered to this instance
        return self.to_offer(offered, taken) or offered

    def to_offer(self, offered: Offered, taken: str) -> Packet | None:
        """Return the answer to an offer that can be answered without the consumer; None if it is to decide."""
        sender, current = offered.offer.sender, self._streams.current
        if current is not None and current.offer.sender == sender:
            return offered.answer(current.beginning)
        if (ended := self._streams.find(sender)) is not None:
            return offered.answer(ended)
        if current is not None:
            self._streams.offered.pop(offered.offer.identity, None)
            return offered.answer(Progress(error=taken))
        return None if self._keys.is_for_this(offered.question) else offered.answer(Progress())

    def refusal(self, offered: Offered, reason: str) -> Packet:
        """Return the answer to an offer that is turned down, now and whenever it comes again."""
        refusal = Progress(error=reason)
        self._streams.turn_down(offered.offer, refusal)
        self.renew()
        return offered.answer(refusal)

    def renew(self) -> None:
        """Be another instance, unless a stream is under way or on offer: nobody takes up what was overheard before."""
        if self._streams.current is None and not self._streams.offered:
            self._keys.renew()

    def to_status(self, packet: Packet) -> Packet:
        """Return the answer to whoever asks how far this is.

        Anyone may ask, but only a sender that has the key gets an answer that is sealed.
        """
        sender = asker(packet.payload)
        seals = self._seals(sender)
        if seals is None or seals.question_number("status", packet) is None:
            if packet.payload:
                self._refuse("status", f"a question that is {_NOT_SEALED}")
            return Packet(self._streams.progress.to_json())
        return seals.answer(packet, (self._streams.find(sender) or Progress()).to_json())

    def _seals(self, sender: str) -> ReceiverSeals | None:
        """Return the seals for a sender; None if it is none."""
        current = self._streams.current
        if current is not None and current.offer.sender == sender:
            return current.seals
        return self._keys.seals(bytes.fromhex(sender)) if is_identifier(sender) else None
