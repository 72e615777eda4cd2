"""The simulated network: channels between the sender and each consumer that lose, repeat, delay and alter packets."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeAlias

from recorders.errors import MessageError
from recorders.protocol.frames import unpack
from recorders.protocol.packets import Packet
from simulation.scenario import PACKET_FAULTS, Fault
from simulation.world import World

Deliver: TypeAlias = Callable[..., None]


class Overheard(NamedTuple):
    """A packet, and the topic or verb that it travelled with."""

    topic: str
    packet: Packet


class Network:
    """Carries packets, and does to them what the faults are.

    Parameters
    ----------
    latency_ns : int
        How long a packet takes that meets no fault.
    faults : iterable of Fault
        Those of packets; others are ignored.
    occurred : counter of str
        Counts the faults that packets met.

    Attributes
    ----------
    overheard : dict of str to list of Overheard
        All that was sent, by channel and consumer.
    """

    def __init__(self, world: World, *, latency_ns: int, faults: Iterable[Fault], occurred: Counter[str]) -> None:
        self._world = world
        self._occurred = occurred
        self._faults = {(fault.where, fault.at): fault for fault in faults if fault.kind in PACKET_FAULTS}
        self._cut_until_ns: dict[str, int] = {}
        self.latency_ns = latency_ns
        self.overheard: defaultdict[str, list[Overheard]] = defaultdict(list)

    def cut(self, consumer: str, duration_ns: int) -> None:
        """Cut the connection to a consumer for a time: what would arrive meanwhile never does."""
        self._cut_until_ns[consumer] = max(self._cut_until_ns.get(consumer, 0), self._world.now_ns + duration_ns)

    def carry(
        self, channel: str, consumer: str, topic: str, packet: Packet, deliver: Deliver, *, type_name: str = ""
    ) -> None:
        """Send a packet; it is handed to `deliver` when it arrives, once, twice or never, and its type beside it."""
        where = f"{channel} {consumer}"
        sent = self.overheard[where]
        fault = self._faults.get((where, len(sent)))
        sent.append(Overheard(topic, packet))
        delay_ns = self.latency_ns
        if self._world.trace is not None:
            self._world.note(f"{where}: {topic} {_shown(packet)}{'' if fault is None else f', {fault.kind}'}")
        if fault is not None:
            self._occurred[f"{channel} {fault.kind}"] += 1
            if fault.kind == "lost":
                return
            if fault.kind == "altered" and type_name and fault.amount % 4 == 0:
                type_name = type_name[:-1]
            elif fault.kind == "altered":
                packet = altered(packet, fault.amount)
            elif fault.kind == "late":
                delay_ns += fault.amount
            else:
                self._world.after(delay_ns + fault.amount, self._arrive, consumer, packet, deliver, type_name)
        self._world.after(delay_ns, self._arrive, consumer, packet, deliver, type_name)

    def _arrive(self, consumer: str, packet: Packet, deliver: Deliver, type_name: str) -> None:
        if self._world.now_ns >= self._cut_until_ns.get(consumer, 0):
            deliver(packet, type_name=type_name) if type_name else deliver(packet)


def altered(packet: Packet, where: int) -> Packet:
    """Return a packet with one bit changed, or cut short by a byte."""
    whole = bytearray(packet.payload + packet.attachment)
    if not whole:
        return packet
    length = len(packet.payload)
    if where & 0xF000 == 0:
        del whole[-1]
    else:
        whole[(where >> 3) % len(whole)] ^= 1 << (where & 7)
    return Packet(bytes(whole[:length]), bytes(whole[length:]))


def _shown(packet: Packet) -> str:
    """Return what a packet holds, as far as it can be read."""
    try:
        frame = unpack("/", *packet)
        return f"{frame.kind.name} {frame.first}, {len(frame.messages)} messages {frame.reason}"
    except MessageError:
        return packet.payload[-120:].decode(errors="replace")
