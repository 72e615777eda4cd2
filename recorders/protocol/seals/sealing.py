"""Seals of both ends of a stream: what each puts on its packets, and how the other finds them authentic.

Offers name the consumer's instance that they are for, and answers the seal of their question: what was overheard of an
earlier stream, of a consumer that was started anew since, or of another question, is no longer taken.
"""

from itertools import count

from recorders.messages.topics import type_of
from recorders.protocol.frames import ATTACHMENT_BYTES, SEAL_BYTES, FrameType
from recorders.protocol.packets import Packet
from recorders.protocol.seals.authentication import (
    INSTANCE_BYTES,
    Signer,
    Verifier,
    consumer_key,
    seal_number,
    sender_key,
)

ANY_INSTANCE = bytes(INSTANCE_BYTES)
"""The instance of a consumer of which none is known yet."""


class SenderSeals:
    """Seals what one sender sends, and checks what its consumers send.

    Parameters
    ----------
    shared : bytes
        The key that both ends share.
    sender : bytes
        The 16 fresh bytes that name this sender.
    """

    def __init__(self, shared: bytes, sender: bytes) -> None:
        self._shared, self._sender = shared, sender
        self._signer = Signer(sender_key(shared, sender))
        self._instances: dict[str, tuple[bytes, Verifier]] = {}

    def frame(self, topic: str, packet: Packet, type_name: str) -> Packet:
        """Return a packet of a frame, sealed; the type is that of a single message."""
        return Packet(packet.payload, packet.attachment + self._signer.seal(*_frame_parts(topic, packet, type_name)))

    def question(self, consumer: str, verb: str, payload: bytes) -> Packet:
        """Return a question to a consumer, sealed; an offer names the instance that it is for."""
        instance = self._instances[consumer][0] if consumer in self._instances else ANY_INSTANCE
        return Packet(payload, instance + self._signer.seal(verb.encode(), consumer.encode(), instance, payload))

    def is_answer(self, consumer: str, question: Packet, answer: Packet) -> bool:
        """Whether an answer is the consumer's to this question; its instance is then the one that is known."""
        instance, seal = _split(answer.attachment)
        known, verifier = self._instances.get(consumer, (b"", None))
        if verifier is None or instance != known:
            verifier = Verifier(consumer_key(self._shared, self._sender, consumer, instance))
        if verifier.number(seal, b"answer", question.attachment, answer.payload) is None:
            return False
        self._instances[consumer] = instance, verifier
        return True

    def is_acknowledgement(self, consumer: str, packet: Packet) -> bool:
        """Whether an acknowledgement is of the instance of a consumer that is known."""
        instance, seal = _split(packet.attachment)
        known, verifier = self._instances.get(consumer, (b"", None))
        return verifier is not None and instance == known and verifier.number(seal, b"ack", packet.payload) is not None


class ReceiverSeals:
    """Seals what one consumer sends to one sender, and checks what that one sends.

    Parameters
    ----------
    shared : bytes
        The key that both ends share.
    sender : bytes
        The 16 bytes that name the sender.
    consumer : str
        Name of the consumer.
    instance : bytes
        Fresh whenever the consumer starts.
    signer : Signer
        Seals under the key of `consumer_key`.
    """

    def __init__(self, shared: bytes, sender: bytes, consumer: str, instance: bytes, signer: Signer) -> None:
        self._consumer, self._instance = consumer.encode(), instance
        self._signer = signer
        self._verifier = Verifier(sender_key(shared, sender))

    def frame_number(self, topic: str, packet: Packet, type_name: str) -> int | None:
        """Return the number of a frame among what its sender has sealed; None if it is not authentic."""
        body = Packet(packet.payload, packet.attachment[:ATTACHMENT_BYTES])
        return self._verifier.number(packet.attachment[ATTACHMENT_BYTES:], *_frame_parts(topic, body, type_name))

    def question_number(self, verb: str, packet: Packet) -> int | None:
        """Return the number of a question among what its sender has sealed; None if it is not authentic."""
        instance, seal = _split(packet.attachment)
        return self._verifier.number(seal, verb.encode(), self._consumer, instance, packet.payload)

    def answer(self, question: Packet, payload: bytes) -> Packet:
        """Return the answer to a question, sealed."""
        return Packet(payload, self._instance + self._signer.seal(b"answer", question.attachment, payload))

    def acknowledgement(self, payload: bytes) -> Packet:
        """Return an acknowledgement, sealed."""
        return Packet(payload, self._instance + self._signer.seal(b"ack", payload))


class ConsumerKeys:
    """Makes the seals of one consumer for each sender that it has to do with.

    Parameters
    ----------
    shared : bytes
        The key that both ends share.
    consumer : str
        Name of the consumer.
    instance : bytes
        Fresh whenever the consumer starts; the next ones count up from it.
    """

    def __init__(self, shared: bytes, consumer: str, instance: bytes) -> None:
        if len(instance) != INSTANCE_BYTES:
            raise ValueError(f"expected an instance of {INSTANCE_BYTES} bytes, found {len(instance)}")
        self._shared, self._consumer, self._instance = shared, consumer, instance
        self._next_number = count().__next__

    def renew(self) -> None:
        """Be another instance from now on, which no offer names that was ever made before."""
        number = (int.from_bytes(self._instance, "big") + 1) % (1 << 8 * INSTANCE_BYTES)
        self._instance = number.to_bytes(INSTANCE_BYTES, "big")

    def is_for_this(self, packet: Packet) -> bool:
        """Whether a question names this instance of the consumer."""
        return _split(packet.attachment)[0] == self._instance

    def seals(self, sender: bytes) -> ReceiverSeals:
        """Return the seals for a sender; one count goes through all of them, so that no number comes twice."""
        key = consumer_key(self._shared, sender, self._consumer, self._instance)
        signer = Signer(key, self._next_number)
        return ReceiverSeals(self._shared, sender, self._consumer, self._instance, signer)


def instance_of(answer: Packet) -> bytes:
    """Return the instance of the consumer that has sealed an answer, which has been found authentic."""
    return _split(answer.attachment)[0]


def question_number(question: Packet) -> int:
    """Return the number of a question's seal, which has been found authentic."""
    return seal_number(_split(question.attachment)[1])


def _frame_parts(topic: str, packet: Packet, type_name: str) -> tuple[bytes, ...]:
    single = packet.attachment[1] == FrameType.MESSAGE
    kind = (type_of(topic) or type_name) if single else ""
    return b"frame", packet.attachment, topic.encode(), kind.encode(), packet.payload


def _split(attachment: bytes) -> tuple[bytes, bytes]:
    """Return the instance and the seal of an attachment; no seal if it is of another size."""
    if len(attachment) != INSTANCE_BYTES + SEAL_BYTES:
        return b"", b""
    return attachment[:INSTANCE_BYTES], attachment[INSTANCE_BYTES:]
