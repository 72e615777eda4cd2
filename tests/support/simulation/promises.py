"""The promises of the protocol, checked after every event of a simulated world."""

import hashlib
from collections.abc import Sequence

from recorders.protocol.frames import records
from recorders.protocol.incoming import MAX_REASON
from recorders.protocol.states import SenderState
from recorders.wire.bounded_queue import ITEM_BYTES
from simulation.consumers import Source
from simulation.limits import PAST_STREAMS
from simulation.receiver_node import ReceiverNode
from simulation.scenario import SENDER, Fault, Scenario
from simulation.sender_node import PATIENCE_S, SenderNode
from simulation.world import MS, SECOND, BrokenPromiseError

_CALM_NS = 50 * MS  # for greeting, farewell and round trips: waiting for the next question takes up to a second
_AWAKE_NS = 2_000 * MS  # until a consumer that has ended is there again
_SHORT_NS = 4_000 * MS  # together; a sender waits 10 s for a consumer, and some of that goes to offers that are lost
_ABORT_BYTES = ITEM_BYTES + MAX_REASON + 100  # it is queued whatever waits
_OFFER_S, _ANSWER_S = 0.5, 5.0  # from one offer to the next, and for an answer to one
_UNANSWERED = " answered within ", "it answers, but not with the key "
_COUNTING = (SenderState.SENDING, SenderState.ENDING)


class Promises:
    """What holds at every moment, and what holds in the end."""

    def __init__(
        self,
        scenario: Scenario,
        source: Source,
        *,
        sender: SenderNode,
        receivers: Sequence[ReceiverNode],
        faults: Sequence[Fault],
    ) -> None:
        self._scenario = scenario
        self._source = source
        self._whole = len(source.messages)
        self._outages_ns = sum(fault.amount for fault in faults if fault.kind in ("kill", "cut", "stall"))
        of_sender = [fault for fault in faults if fault.where == SENDER]
        self._jumps = sum(fault.kind == "clock jump" and fault.amount > 0 for fault in of_sender)
        self._stalls_s = sum(fault.amount for fault in of_sender if fault.kind == "stall") / SECOND
        batch, batch_bytes = scenario.batch_size, scenario.batch_size * scenario.most_bytes
        # What need not be acknowledged yet, and a frame; or all that the window holds.
        self._most = max(scenario.window, max(1, scenario.window // 2) - 1 + batch)
        self._most_bytes = max(scenario.window_bytes, scenario.window_bytes // 4 - 1 + batch_bytes)
        self._sender = sender
        self._receivers = {receiver.name: receiver for receiver in receivers}

    def check_sender(self) -> None:
        """Check what holds whenever the sender has done something."""
        machine = self._sender.machine
        window, state = machine._window, machine.state
        sent, consumed = window.sent, window.consumed
        if not 0 <= consumed <= self._whole or not 0 <= sent <= self._whole:
            _break("nothing is sent beyond the end", f"message {sent} of {self._whole}, {consumed} are consumed")
        if self._sender.has_asked:
            self._sender.has_asked = False
            self._check_questions()
        if state is SenderState.GREETING:
            self._check_greeted()
        elif state in _COUNTING:
            self._check_window(sent, consumed, len(window._frames))
            for receiver in self._receivers.values():
                had = receiver.consumer.had.get(self._sender.offer.sender, 0)
                if consumed > had:
                    _break("acknowledged means consumed", f"up to {consumed}, while {receiver.name} has {had}")

    def _check_window(self, sent: int, consumed: int, frames: int) -> None:
        under_way, size = sent - consumed, self._source.sizes[sent] - self._source.sizes[consumed]
        most_frames = 2 * self._most + 1  # some may be consumed already, which is noted with the next answer
        if under_way > self._most or size > self._most_bytes or frames > most_frames:
            _break(
                "memory is bounded",
                f"{under_way} messages of {size} bytes are under way in {frames} frames, {self._most} of "
                f"{self._most_bytes} bytes may be",
            )

    def _check_questions(self) -> None:
        """Check how many questions there are; without a new one there cannot be too many, as time allows for more."""
        since_s = self._sender.now_s - self._sender.begun_s
        for (name, verb), count in self._sender.questions_asked.items():
            most = 10 + 25 * since_s if verb == "hello" else 10 + 2 * since_s + self._sender.acknowledgements[name]
            if count > most:
                _break("nobody is flooded", f"{name} was asked its {verb} {count} times in {since_s:.3f} s")

    def _check_greeted(self) -> None:
        most_s = max(self._scenario.wait_s, _ANSWER_S) + self._stalls_s + 2 * _OFFER_S
        if self._sender.greeted_s > most_s:
            _break("nobody is awaited for ever", f"a consumer had {self._sender.greeted_s} s, {most_s} s are enough")

    def check_error(self, error: str) -> None:
        """Check that an error of the sender's has its cause."""
        waited_s = self._sender.now_s - self._sender.waits_since_s
        if "the rest of the stream is unconfirmed" in error and waited_s < PATIENCE_S:
            _break("a pause tries nobody's patience", f"{error}, and it waited {waited_s} s")
        greeted_s, jumps_s = self._sender.greeted_s, self._jumps * _OFFER_S
        if any(each in error for each in _UNANSWERED) and greeted_s < self._scenario.wait_s - jumps_s:
            _break("who is awaited has its time", f"{error}, and it had {greeted_s} s")
        for name in self._sender.doubted:
            if f"no consumer named {name!r} answered" in error:
                _break("what others answer is reported", f"found {error}")

    def check_receiver(self, receiver: ReceiverNode) -> None:
        """Check what holds whenever a consumer's process has done something."""
        machine, consumer = receiver.machine, receiver.consumer
        if machine.offer is not None and machine.progress.next > consumer.next:
            _break("acknowledged means consumed", f"{receiver.name} has {consumer.next}, states {machine.progress}")
        past = len(machine._streams._ended)
        if past > PAST_STREAMS:
            _break("memory is bounded", f"{past} streams are remembered at {receiver.name}, {PAST_STREAMS} may be")
        waiting, limit = receiver.waiting_bytes, consumer.plan.waiting_bytes
        if waiting > limit + _ABORT_BYTES + ITEM_BYTES:
            _break("memory is bounded", f"{waiting} bytes wait at {receiver.name}, {limit} may")

    def check_end(self, ended_ns: int, over_ns: int) -> None:
        """Check what holds when it is over: one digest, durable with every consumer; no error without a cause."""
        results = self._sender.results or {}
        _expect(set(results) == set(self._receivers), "it ends with every result", f"found those of {sorted(results)}")
        for name, result in results.items():
            expected = {"messages": self._whole, "digest": self._source.digests[-1]}
            _expect(result == expected, "one digest", f"{name} reports {result}, the source has {expected}")
            self._check_digest(name)
            consumer = self._receivers[name].consumer
            _expect(consumer.durable == self._whole, "what is reported is durable", f"{name} has {consumer.durable}")
        errors = [*self._sender.errors, *(error for each in self._receivers.values() for error in each.errors)]
        _expect(all(errors), "errors are stated", f"found {errors}")
        if self._scenario.calm:
            slowest_ns = max(plan.consume_ns for plan in self._scenario.consumers)
            most_ns = self._whole * (slowest_ns + self._scenario.gap_ns) + _CALM_NS
            most_ns += sum(plan.decide_ns for plan in self._scenario.consumers)
            _expect(ended_ns <= most_ns, "nothing waits without need", f"ended after {ended_ns} ns, not {most_ns} ns")
            _expect(
                over_ns <= ended_ns + _AWAKE_NS, "nothing waits without need", f"over {over_ns - ended_ns} ns later"
            )
        if self._scenario.gentle and self._outages_ns <= _SHORT_NS:
            _expect(not errors, "nobody gives up without need", f"found {errors}")

    def _check_digest(self, name: str) -> None:
        """Check that the digest that both ends compared is of all messages from where the consumer began."""
        compared = self._sender.machine.outbox.digests
        start = compared._starts[name]
        expected = hashlib.sha256(records(self._source.messages[start:])).hexdigest()
        found = compared.digest(name)
        _expect(found == expected, "what is compared is the whole stream", f"{found} for {name} from {start} on")


def _expect(holds: bool, promise: str, found: str) -> None:
    if not holds:
        _break(promise, found)


def _break(promise: str, found: str) -> None:
    raise BrokenPromiseError(promise, found)
