"""Both ends of a stream in one process, with a key of the tests, and what a sender seals."""

import zenoh

from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType, batch_topic, pack
from recorders.protocol.packets import Packet, read_progress
from recorders.protocol.receiver import ReceiverMachine
from recorders.protocol.seals.authentication import INSTANCE_BYTES, KEY_BYTES
from recorders.protocol.seals.sealing import SenderSeals
from recorders.protocol.sender import SenderMachine
from recorders.protocol.stream import Offer, Progress
from recorders.wire.keys.namespace import control_key, message_key
from recorders.wire.shared_key import shared_key

KEY = bytes(range(KEY_BYTES))
INSTANCE = b"i" * INSTANCE_BYTES


def receiver(
    name: str = "learner", *, silence_s: float = 30.0, instance: bytes = INSTANCE, key: bytes = KEY
) -> ReceiverMachine:
    return ReceiverMachine(name, key=key, instance=instance, silence_s=silence_s)


def sender(
    offer: Offer, consumers: tuple[str, ...], *, batched: bool, wait_s: float, patience_s: float
) -> SenderMachine:
    return SenderMachine(offer, consumers, key=KEY, batched=batched, wait_s=wait_s, patience_s=patience_s)


class Sealing:
    """Seals the frames and the questions of one sender, as its machine does."""

    def __init__(self, offer: Offer, *, key: bytes = KEY, consumer: str = "learner") -> None:
        self._offer, self._consumer = offer, consumer
        self._seals = SenderSeals(key, offer.identity[1])

    def frame(self, frame: Frame) -> tuple[str, Packet]:
        """The topic that a frame travels on, and its packet."""
        single = frame.kind is FrameType.MESSAGE
        topic, kind = (frame.messages[0].topic, frame.messages[0].type) if single else (batch_topic(), "")
        return topic, self._seals.frame(topic, Packet(*pack(frame)), kind)

    def question(self, verb: str, payload: bytes) -> Packet:
        return self._seals.question(self._consumer, verb, payload)

    def is_answer(self, question: Packet, answer: Packet) -> bool:
        return self._seals.is_answer(self._consumer, question, answer)

    def hello(self, machine: ReceiverMachine) -> Packet | Offered:
        """What comes of an offer to a consumer; the first answer of one that is not known yet names its instance."""
        question = self.question("hello", self._offer.to_json())
        answer = machine.on_hello(question)
        if isinstance(answer, Packet) and read_progress(answer) == Progress():
            assert self.is_answer(question, answer)
            return machine.on_hello(self.question("hello", self._offer.to_json()))
        return answer


class Peer:
    """A sender on the network that has the user's key, and does only what it is told to.

    Parameters
    ----------
    session : zenoh.Session
        An open session, connected to that of a consumer.
    offer : Offer
        The stream that it offers.
    """

    def __init__(self, session: zenoh.Session, offer: Offer) -> None:
        self._session, self._offer = session, offer
        self._sealing = Sealing(offer, key=shared_key())

    def offer(self) -> "zenoh.Handler[zenoh.Reply]":
        """Offer the stream to the consumer's instance, which is asked for first; returns its answers to come."""
        question = self._sealing.question("hello", self._offer.to_json())
        (first,) = self._get("hello", question)
        assert first.ok is not None
        assert first.ok.attachment is not None
        answer = Packet(first.ok.payload.to_bytes(), first.ok.attachment.to_bytes())
        assert self._sealing.is_answer(question, answer)
        return self._get("hello", self._sealing.question("hello", self._offer.to_json()))

    def ask(self, verb: str, payload: bytes) -> Progress | None:
        """Ask the consumer; when it answers, what was put before has come there too."""
        question = self._sealing.question(verb, payload)
        for reply in self._get(verb, question):
            if reply.ok is not None:
                attachment = b"" if reply.ok.attachment is None else reply.ok.attachment.to_bytes()
                answer = Packet(reply.ok.payload.to_bytes(), attachment)
                self._sealing.is_answer(question, answer)  # the consumer's instance is then known
                return Progress.from_json(answer.payload)
        return None

    def put(self, frame: Frame) -> None:
        topic, packet = self._sealing.frame(frame)
        self._session.put(message_key("reenact", topic), packet.payload, attachment=packet.attachment)

    def _get(self, verb: str, packet: Packet) -> "zenoh.Handler[zenoh.Reply]":
        key = control_key("reenact", "learner", verb)
        return self._session.get(key, payload=packet.payload, attachment=packet.attachment, timeout=120.0)
