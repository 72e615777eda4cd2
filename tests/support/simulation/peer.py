"""A hostile peer: it overhears everything, knows run and sender of the stream, and has all but the key."""

import json
import random
from collections.abc import Sequence
from dataclasses import replace

from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import SEAL_BYTES, Frame, FrameType, batch_topic, pack
from recorders.protocol.packets import Packet
from recorders.protocol.seals.authentication import INSTANCE_BYTES
from recorders.protocol.stream import Offer, Progress, asking
from simulation.network import Network, Overheard
from simulation.receiver_node import ReceiverNode
from simulation.scenario import Fault
from simulation.sender_node import SenderNode
from simulation.world import SECOND

_OFFERS, _OFFERED_AGAIN = 6, 8

FORGED = RecordedMessage("/hand/left/target", "geometry_msgs/msg/PoseStamped", b"forged", 7, 7)


class Peer:
    """Sends what it forges, and again what it overheard, to a consumer, or to the sender in the consumer's name."""

    def __init__(self, *, network: Network, sender: SenderNode, receivers: Sequence[ReceiverNode]) -> None:
        self._network = network
        self._sender = sender
        self._receivers = {receiver.name: receiver for receiver in receivers}

    def meddle(self, fault: Fault) -> bool:
        """Do what a fault is; False if there is nothing yet to copy or to answer."""
        if not hasattr(self._sender, "machine"):  # it was killed before it could begin
            return False
        draw = random.Random(fault.amount)
        what, _, how = fault.kind.partition(" ")
        if how == "copied":
            return self._copy(what, fault.where, draw)
        return self._forge(what, fault.where, draw)

    def _copy(self, channel: str, consumer: str, draw: random.Random) -> bool:
        """Send once more what was overheard: the same bytes, at another time."""
        if channel == "offer":
            return self._offer_again(consumer, _OFFERED_AGAIN)
        overheard = self._network.overheard[f"{channel} {consumer}"]
        if not overheard:
            return False
        self._send(channel, consumer, draw.choice(overheard))
        return True

    def _offer_again(self, consumer: str, times: int) -> bool:
        """Make the last offers once more that were overheard, now and some times later."""
        offers = [sent for sent in self._network.overheard[f"question {consumer}"] if sent.topic == "hello"]
        for sent in offers[-_OFFERS:]:
            self._send("question", consumer, sent)
        if times:
            self._sender.world.after(5 * SECOND, self._offer_again, consumer, times - 1)
        return bool(offers)

    def _forge(self, what: str, consumer: str, draw: random.Random) -> bool:
        if what in ("message", "batch", "end", "abort"):
            self._send("data", consumer, self._frame(what, draw))
        elif what in ("acknowledgement", "result", "failure"):
            self._send("acknowledgement", consumer, Overheard("ack", self._progress(what, draw)))
        elif what == "answer":
            return self._answer(consumer, draw)
        else:
            self._send("question", consumer, self._question(what, draw))
        return True

    def _send(self, channel: str, consumer: str, sent: Overheard) -> None:
        if channel == "data":
            self._receivers[consumer].published(sent.topic, sent.packet)
        elif channel == "acknowledgement":
            self._sender.acknowledged(consumer, sent.packet)
        elif channel == "answer":
            for question in self._sender.questions(consumer)[:1]:
                self._sender.hand(self._sender.answered, question, sent.packet)
        else:
            self._receivers[consumer].asked(sent.topic, lambda packet: None, sent.packet)

    def _frame(self, what: str, draw: random.Random) -> Overheard:
        """A frame of the stream under way, or of a stranger's, at or near the place where the next one is due."""
        offer = self._offer(draw)
        kind = FrameType[what.upper()]
        messages = {"message": (FORGED,), "batch": (FORGED,) * draw.randint(1, 3)}.get(what, ())
        first = max(0, self._sender.machine.sent + draw.randint(-2, 2))
        frame = Frame(kind, *offer.identity, first, messages, "forged" if what == "abort" else "")
        topic = FORGED.topic if what == "message" else batch_topic()
        return Overheard(topic, self._signed(Packet(*pack(frame)), draw))

    def _progress(self, what: str, draw: random.Random) -> Packet:
        """A consumer's progress that it never came to."""
        sent = self._sender.machine.sent
        index = max(0, sent + draw.randint(-3, 3))
        run = draw.choice((self._sender.offer.run, "f" * 32))
        progress = Progress(run, index, index)
        if what == "result":
            progress = replace(progress, result={"messages": index, "digest": "forged"})
        elif what == "failure":
            progress = replace(progress, error="forged")
        payload = progress.to_json()
        return self._signed(Packet(_mangled(payload, draw)), draw)

    def _question(self, what: str, draw: random.Random) -> Overheard:
        offer = self._offer(draw)
        if what == "offer":
            offer = replace(offer, run=draw.choice((offer.run, "e" * 32)), window=draw.randint(1, 9))
            payload = offer.to_json()
            return Overheard("hello", self._signed(Packet(_mangled(payload, draw)), draw))
        return Overheard("status", self._signed(Packet(asking(offer, farewell=what == "farewell")), draw))

    def _answer(self, consumer: str, draw: random.Random) -> bool:
        """Answer a question of the sender's before the consumer does."""
        questions = self._sender.questions(consumer)
        if not questions:
            return False
        what = draw.choice(("acknowledgement", "result", "failure"))
        self._sender.hand(self._sender.answered, draw.choice(questions), self._progress(what, draw))
        return True

    def _offer(self, draw: random.Random) -> Offer:
        """The offer of the stream under way, as it was overheard, or a stranger's."""
        return replace(self._sender.offer, sender=draw.choice((self._sender.offer.sender, draw.randbytes(16).hex())))

    def _signed(self, packet: Packet, draw: random.Random) -> Packet:
        """Return a packet as well signed as whoever lacks the key can: not at all, at random, or with a copied seal."""
        overheard = [sent.packet.attachment for packets in self._network.overheard.values() for sent in packets[-3:]]
        size = draw.choice((0, SEAL_BYTES, INSTANCE_BYTES + SEAL_BYTES))
        seals = [draw.randbytes(size), *(attachment[-size:] for attachment in overheard if size)]
        return packet._replace(attachment=packet.attachment + draw.choice(seals))


def _mangled(payload: bytes, draw: random.Random) -> bytes:
    """Return an object as it is, or with one value of another type, or out of range."""
    if draw.random() < 0.7:
        return payload
    fields = json.loads(payload)
    fields[draw.choice(sorted(fields))] = draw.choice((None, [], "x", -1, {}, True, 1.5, 1 << 70))
    return json.dumps(fields).encode()
