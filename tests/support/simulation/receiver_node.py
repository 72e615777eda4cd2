"""A simulated consumer's process: the protocol's receiving machine, its queue, and the consumer that takes from it."""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial

from recorders.errors import MessageError, ReenactError
from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.packets import Packet
from recorders.protocol.receiver import FAREWELL_WAIT_S, ReceiverMachine
from recorders.protocol.seals.authentication import INSTANCE_BYTES
from recorders.protocol.stream import Progress
from recorders.wire.bounded_queue import BoundedQueue
from simulation.consumers import SimulatedConsumer, Source
from simulation.network import Network
from simulation.node import Node
from simulation.scenario import KEY, ConsumerPlan, Fault
from simulation.world import SECOND, BrokenPromiseError, World, draws

SILENCE_S = 30.0

_TO_ANOTHER = Progress().to_json()  # the answer to an offer that is to be made to this instance

Reply = Callable[[Packet | None], None]


class ReceiverNode(Node):
    """Receives for one consumer, which is started again whenever it ends.

    Attributes
    ----------
    consumer : SimulatedConsumer
        What takes the messages.
    machine : ReceiverMachine
        That of the life under way.
    errors : list of str
        Why each life that failed did.
    """

    def __init__(
        self,
        world: World,
        plan: ConsumerPlan,
        source: Source,
        *,
        seed: int,
        network: Network,
        faults: Iterable[Fault],
        occurred: Counter[str],
    ) -> None:
        super().__init__(world, plan.name, faults=faults, occurred=occurred)
        self._network = network
        self.consumer = SimulatedConsumer(plan, source, self.wall_ns)
        self.machine: ReceiverMachine
        self._draw = draws(seed, plan.name)
        self._decided = 0  # offers
        self.errors: list[str] = []
        self.aborts: dict[Packet, str]  # of senders, by what they publish when they give up
        self.acknowledged: Callable[[str, Packet], None]

    def on_begin(self) -> None:
        """Wait for a stream."""
        instance = self._draw.randbytes(INSTANCE_BYTES)
        self._refused = 0
        self.machine = ReceiverMachine(
            self.name, key=KEY, instance=instance, silence_s=SILENCE_S, refuse=self._note_refusal
        )
        self._queue: BoundedQueue[Frame | tuple[Offered, Reply]] = BoundedQueue(limit=self.consumer.plan.waiting_bytes)
        self._busy = self._leaving = False
        self._answered: set[Packet] = set()  # offers
        self._offered: set[str] = set()  # senders
        self._gave_up: set[str] = set()  # those of them

    @property
    def waiting_bytes(self) -> int:
        """How much waits in the queue."""
        return self._queue._waiting

    def published(self, topic: str, packet: Packet, *, type_name: str = "") -> None:
        """Take what came on a data key, with the type of a message that travels alone."""
        self.hand(self._on_sample, topic, packet, type_name)

    def asked(self, verb: str, reply: Reply, packet: Packet) -> None:
        """Answer a question."""
        if self.is_up:
            self.hand(self._on_hello if verb == "hello" else self._on_status, packet, reply)
        else:
            reply(None)

    def on_event(self) -> None:
        """Let the consumer take what waits."""
        while not (self._busy or self._leaving) and self.is_up and (item := self._queue.get(0.0)) is not None:
            self._take(item)
        if self._leaving and self.machine.released:
            self.end(SECOND)

    def deadline_s(self) -> float:
        """Return when the machine wants to be woken."""
        return math.inf if self._busy or self._leaving else self.machine.deadline_s

    def on_time(self) -> None:
        """Wake the machine; it may report that the sender is gone."""
        offer, error = self.machine.offer, self.machine.on_time(self.now_s)
        if error is None:
            return
        if offer is not None and offer.sender in self._gave_up and str(error).startswith("the sender fell silent"):
            raise BrokenPromiseError("who gives up is not awaited", f"{self.name} states: {error}")
        self._lose(str(error))

    def _note_refusal(self, what: str, why: str) -> None:
        self._refused += 1

    def _expect_counted(self, answer: Packet, counted: int, *, is_refused: bool) -> None:
        """Check that a question which was refused is counted, beyond those before it."""
        if is_refused and self._refused == counted:
            raise BrokenPromiseError("what is refused is counted", f"{self.name} answers {answer}")

    def _on_sample(self, topic: str, packet: Packet, type_name: str) -> None:
        sender = self.aborts.get(packet)
        if sender in self._offered:
            self._gave_up.add(sender)
        if not self.machine.concerns(packet.attachment):
            return
        try:
            frame = self.machine.on_sample(topic, packet, self.now_s, type_name=type_name)
        except MessageError:
            return  # refused, and counted
        if frame is None:
            return
        if self._queue.put(frame, frame.size or len(frame.reason), always=frame.kind is FrameType.ABORT):
            self.machine.arrived(frame)

    def _on_hello(self, packet: Packet, reply: Reply) -> None:
        counted, answer = self._refused, self.machine.on_hello(packet)
        if isinstance(answer, Packet):
            self._expect_counted(answer, counted, is_refused=b"not sealed" in answer.payload)
            self._answer(packet, answer, reply)
        elif self._queue.put((answer, reply), answer.size):
            self.machine.waiting(answer)
            self._offered.add(answer.offer.sender)
        else:
            reply(None)

    def _answer(self, offer: Packet, answer: Packet, reply: Reply) -> None:
        """Answer an offer once and for all, unless it is to be made to this instance."""
        if answer.payload != _TO_ANOTHER:
            self._answered.add(offer)
        reply(answer)

    def _on_status(self, packet: Packet, reply: Reply) -> None:
        counted, answer = self._refused, self.machine.on_status(packet)
        self._expect_counted(answer, counted, is_refused=bool(packet.payload) and not answer.attachment)
        reply(answer)
        self.step()
        self.machine.on_status_answered(packet, answer, self.now_s)

    def _take(self, item: Frame | tuple[Offered, Reply]) -> None:
        self.step()
        try:
            if not isinstance(item, Frame):
                self._take_offer(*item)
            elif item.kind is FrameType.END:
                self._acknowledge(self.machine.finish(self.consumer.result(), self.now_s))
                if self.consumer.plan.kind == "learner":
                    self._leave()
            elif item.kind is FrameType.ABORT:
                self._lose(item.reason)
            else:
                self._take_messages(item)
        except ReenactError as error:
            self._fail(str(error))

    def _take_offer(self, offered: Offered, reply: Reply) -> None:
        answer = self.machine.answer(offered)  # another may have been accepted since it came
        if answer is not None:
            self._answer(offered.question, answer, reply)
            return
        self._busy = True
        self.later(self.consumer.plan.decide_ns >> self._decided, self._accept, offered, reply)

    def _accept(self, offered: Offered, reply: Reply) -> None:
        self._busy = False
        self._decided += 1
        if self._decided <= self.consumer.plan.refuses:
            self._answer(offered.question, self.machine.refuse(offered, "not at present"), reply)
            return
        if offered.question in self._answered:
            raise BrokenPromiseError("no offer is taken twice", f"{self.name} takes {offered.offer}")
        start = self.consumer.start(offered.offer)
        self._answer(offered.question, self.machine.accept(offered, start, self.now_s), reply)

    def _take_messages(self, frame: Frame) -> None:
        for message in frame.messages:
            self.consumer.take(message)
            self.step()
        self._busy = True
        self.later(self.consumer.plan.consume_ns * len(frame.messages), self._consumed, frame)

    def _consumed(self, frame: Frame) -> None:
        self._busy = False
        self._acknowledge(self.machine.consume(frame))

    def _lose(self, reason: str) -> None:
        """Leave a stream whose sender is gone: a learner ends with an error, a recorder awaits the next stream."""
        if self.consumer.plan.kind == "learner":
            self._fail(reason)
        else:
            self.errors.append(reason)
            self.world.note(f"{self.name} states: {reason}")
            self.machine.abandon(reason)

    def _fail(self, reason: str) -> None:
        """End with an error, which the sender is to learn."""
        self.errors.append(reason)
        self.world.note(f"{self.name} states: {reason}")
        self._acknowledge(self.machine.fail(reason, self.now_s))
        self._leave()

    def _leave(self) -> None:
        """Take nothing more, and end when the sender knows what there is to know, or does not come for it."""
        self._leaving = True
        self.later(int(FAREWELL_WAIT_S * 1e9), self.machine.abandon)

    def _acknowledge(self, packet: Packet | None) -> None:
        self.step()
        if packet is None:
            return
        self._network.carry("acknowledgement", self.name, "ack", packet, partial(self.acknowledged, self.name))
