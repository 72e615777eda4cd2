"""The simulated sender: the protocol's sending machine, what it sends from, and the operator who starts it again."""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from recorders.protocol.frames import FrameType
from recorders.protocol.packets import Ask, Packet, Publish
from recorders.protocol.seals.authentication import INSTANCE_BYTES
from recorders.protocol.sender import SenderMachine
from recorders.protocol.states import SenderState
from recorders.protocol.stream import Offer, Progress
from simulation.consumers import Source
from simulation.network import Network
from simulation.node import Node
from simulation.receiver_node import ReceiverNode
from simulation.scenario import KEY, SENDER, Fault, Scenario
from simulation.world import SECOND, BrokenPromiseError, World, draws

_FORGED = Progress(error="forged").to_json()

PATIENCE_S = 30.0


class SenderNode(Node):
    """Sends the source to every consumer, one attempt after the other, until one gets through.

    Attributes
    ----------
    machine, offer : SenderMachine, Offer
        Those of the attempt under way.
    begun_s : float
        When that began, on the sender's clock.
    questions_asked, acknowledgements : counter of (str, str), counter of str
        How often it asked each consumer what, and how often something was published as its acknowledgement.
    has_asked : bool
        Whether it has asked anything since that was last checked.
    waits_since_s : float
        Since when messages, or the end, wait for the consumers, on its clock.
    doubted : set of str
        The consumers in whose name somebody else has answered.
    aborts : dict of Packet to str
        The senders that gave up, by what they published of it.
    errors : list of str
        Why each attempt that failed did.
    ended_ns : int
        When an attempt got through.
    results : dict of str to dict, optional
        What the consumers reported to the attempt that got through.
    """

    def __init__(
        self,
        world: World,
        scenario: Scenario,
        source: Source,
        *,
        network: Network,
        receivers: Iterable[ReceiverNode],
        faults: Iterable[Fault],
        occurred: Counter[str],
    ) -> None:
        super().__init__(world, SENDER, faults=faults, occurred=occurred)
        self._scenario = scenario
        self._source = source
        self._network = network
        self._receivers = {receiver.name: receiver for receiver in receivers}
        self._source_faults = {fault.at: fault for fault in faults if fault.kind.startswith("source ")}
        self._draw = draws(scenario.seed, "sender")
        self._asked: dict[int, Ask] = {}
        self._ready_ns = self._woken_ns = 0  # when the source has its next message, and wakes for it
        self._impostors_until_ns: dict[str, int] = {}
        self.machine: SenderMachine
        self.offer: Offer
        self.begun_s = 0.0
        self._greeted_since_ns, self._greeted = 0, ""
        self.waits_since_s = math.inf
        self.questions_asked: Counter[tuple[str, str]] = Counter()
        self.has_asked = False
        self.acknowledgements: Counter[str] = Counter()
        self.doubted: set[str] = set()
        self.aborts: dict[Packet, str] = {}
        self.errors: list[str] = []
        self.ended_ns = 0
        self.results: dict[str, dict[str, Any]] | None = None
        self.check_error: Callable[[str], None]

    @property
    def greeted_s(self) -> float:
        """For how long the consumer that is greeted could answer: since it was its turn, or since it appeared [s]."""
        return (self.world.now_ns - self._greeted_since_ns) / SECOND

    def on_begin(self) -> None:
        """Offer the stream, as a sender of its own."""
        plan, source = self._scenario, self._source
        self.offer = Offer(
            run=source.run,
            schedule={},
            logs=[],
            messages=len(source.messages) if plan.counted else None,
            sender=self._draw.randbytes(16).hex(),
            window=plan.window,
        )
        self._asked = {}
        self._greeted = ""
        self._appeared: set[bytes] = set()
        self.begun_s = self.now_s
        self.waits_since_s = math.inf
        self._refused = 0
        self.doubted.clear()
        self.questions_asked.clear()
        self.acknowledgements.clear()
        self.machine = SenderMachine(
            self.offer,
            tuple(self._receivers),
            key=KEY,
            batched=plan.batch_size > 1,
            wait_s=plan.wait_s,
            patience_s=PATIENCE_S,
            refuse=self._note_refusal,
        )
        self.machine.start(self.now_s)

    def on_event(self) -> None:
        """Do what the machine wants, send what there is room for, and see how it stands."""
        self._act()
        while self.machine.state is SenderState.SENDING and self._send():
            self._act()
        if self.machine.state is SenderState.DONE:
            self.results = self.machine.results
            self.stop()
            self.ended_ns = self.world.now_ns
        elif self.machine.state is SenderState.FAILED:
            self.errors.append(str(self.machine.error))
            self.check_error(self.errors[-1])
            self.world.note(f"{self.name} states: {self.errors[-1]}")
            self.end(self._draw.randint(SECOND, 10 * SECOND))

    def deadline_s(self) -> float:
        """Return when the machine wants to be woken."""
        return self.machine.deadline_s

    def on_time(self) -> None:
        """Wake the machine."""
        self.machine.on_time(self.now_s)

    def acknowledged(self, consumer: str, packet: Packet) -> None:
        """Take what came on the acknowledgement key of a consumer."""
        self.hand(self._on_acknowledgement, consumer, packet)

    def _on_acknowledgement(self, consumer: str, packet: Packet) -> None:
        self.acknowledgements[consumer] += 1
        self.machine.on_acknowledgement(consumer, packet, self.now_s)

    def answered(self, ask: Ask, packet: Packet | None) -> None:
        """Take an answer to a question, or that there are no more."""
        if self._asked.get(ask.number) is not ask:
            return
        counted, was_over, was_awaited = self._refused, self.machine.is_over, self.machine.awaits(ask)
        self.machine.on_answer(ask, packet, self.now_s)
        if not self.machine.awaits(ask):
            del self._asked[ask.number]
            if was_awaited:
                self._note_appearance(ask, packet)
        elif packet is not None and not was_over:
            self.doubted.add(ask.consumer)
            if self._refused == counted:
                raise BrokenPromiseError("what is refused is counted", f"the answer {packet} is not")

    def _note_appearance(self, ask: Ask, packet: Packet | None) -> None:
        """Note an answer that was taken: a consumer that had not appeared yet may take its time from now on."""
        if ask.verb == "hello" and packet is not None and packet.payload == Progress().to_json():
            instance = packet.attachment[:INSTANCE_BYTES]
            if instance not in self._appeared:
                self._appeared.add(instance)
                self._greeted_since_ns = self.world.now_ns

    def _note_question(self, ask: Ask) -> None:
        self.questions_asked[ask.consumer, ask.verb] += 1
        self.has_asked = True
        if ask.verb != "hello":
            self._greeted = "" if ask.consumer == self._greeted else self._greeted
        elif ask.consumer != self._greeted:
            self._greeted, self._greeted_since_ns = ask.consumer, self.world.now_ns

    def _note_refusal(self, what: str, why: str) -> None:
        self._refused += 1

    def _answered_by_consumer(self, ask: Ask, packet: Packet) -> None:
        """Take the last answer that is to be expected, changed on its way or not."""
        self.answered(ask, packet)
        self.answered(ask, None)

    def _time_out(self, ask: Ask) -> None:
        if self._asked.get(ask.number) is ask:
            self.hand(self.answered, ask, None)

    def questions(self, consumer: str) -> list[Ask]:
        """Return what a consumer is asked and has not answered yet."""
        return [ask for ask in self._asked.values() if ask.consumer == consumer]

    def meet_impostor(self, fault: Fault) -> None:
        """Be answered in a consumer's name, for a time, before it answers itself."""
        until_ns = self._impostors_until_ns.get(fault.where, 0)
        self._impostors_until_ns[fault.where] = max(until_ns, self.world.now_ns + fault.amount)

    def _act(self) -> None:
        """Do what the machine wants done; a kill may come in between."""
        for action in self.machine.outbox.take():
            self.step()
            if isinstance(action, Publish):
                if action.frame.kind is FrameType.ABORT:
                    self.aborts[action.packet] = self.offer.sender
                kind = action.frame.messages[0].type if action.frame.kind is FrameType.MESSAGE else ""
                for receiver in self._receivers.values():
                    deliver = partial(receiver.published, action.topic)
                    self._network.carry("data", receiver.name, action.topic, action.packet, deliver, type_name=kind)
            else:
                self._asked[action.number] = action
                self._note_question(action)
                self.world.after(int(action.timeout_s * 1e9), self._time_out, action)
                if self.world.now_ns < self._impostors_until_ns.get(action.consumer, 0):
                    self.world.after(0, self.hand, self.answered, action, Packet(_FORGED, action.packet.attachment))
                deliver = partial(self._receivers[action.consumer].asked, action.verb, partial(self._reply, action))
                self._network.carry("question", action.consumer, action.verb, action.packet, deliver)

    def _reply(self, ask: Ask, packet: Packet | None) -> None:
        """Carry a consumer's answer back; None is that of a connection that nobody is at the end of."""
        if packet is None:
            self.later(self._network.latency_ns, self.answered, ask, None)
        else:
            deliver = partial(self.hand, self._answered_by_consumer, ask)
            self._network.carry("answer", ask.consumer, ask.verb, packet, deliver)

    def _send(self) -> bool:
        """Send what comes next; False if there is no room, or it is not there yet."""
        machine, messages, begun = self.machine, self._source.messages, self.machine.sent
        if begun == len(messages):
            machine.end()
            self.waits_since_s = self.now_s
            return True
        if begun in self._source_faults:
            self._meet_source_fault(self._source_faults.pop(begun))
            if machine.state is not SenderState.SENDING:
                return True
        if self.world.now_ns < self._ready_ns:
            if self._woken_ns != self._ready_ns:
                self._woken_ns = self._ready_ns
                self.later(self._ready_ns - self.world.now_ns, lambda: None)
            return False
        chunk = tuple(messages[begun : begun + self._scenario.batch_size])
        if not machine.send(chunk):
            self.waits_since_s = min(self.waits_since_s, self.now_s)
            return False
        if machine.sent != begun + len(chunk):
            raise BrokenPromiseError("what is sent counts", f"message {machine.sent} is due after {begun}")
        self.waits_since_s = math.inf
        self._ready_ns = self.world.now_ns + self._scenario.gap_ns * len(chunk)
        return True

    def _meet_source_fault(self, fault: Fault) -> None:
        self.occurred[fault.kind] += 1
        if fault.kind == "source fails":
            self.machine.abort("the log ends in the middle of a message")
        else:
            self._ready_ns = self.world.now_ns + fault.amount
