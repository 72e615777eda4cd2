"""A sender and its consumers in one process, without a network: what is sent arrives at once, or is lost."""

import math
from collections.abc import Callable

from sealed import receiver, sender

from recorders.messages.record import RecordedMessage
from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.sender import SenderMachine
from recorders.protocol.states import SenderState
from recorders.protocol.stream import Offer

COUNT = 20
OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8, messages=COUNT)
WAIT_S, PATIENCE_S = 10.0, 30.0


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


class Consumer:
    """A consumer in the same process that consumes at once; `start` is where it goes on."""

    def __init__(self, start: int = 0, *, refuses: str = "", fails_at: int = -1) -> None:
        self._start, self._refuses, self._fails_at = start, refuses, fails_at
        self.machine = receiver()  # of another name as soon as it has one
        self.taken: list[int] = []
        self.aborted = ""
        self.acknowledgements: list[Packet | None] = []

    def answer(self, ask: Ask, now_s: float) -> Packet:
        if ask.verb == "status":
            answer = self.machine.on_status(ask.packet)
            self.machine.on_status_answered(ask.packet, answer, now_s)
            return answer
        offered = self.machine.on_hello(ask.packet)
        if not isinstance(offered, Offered):
            return offered
        if self._refuses:
            return self.machine.refuse(offered, self._refuses)
        return self.machine.accept(offered, self._start, now_s)

    def take(self, sent: Publish, now_s: float) -> None:
        frame = self.machine.on_sample(sent.topic, sent.packet, now_s)
        if frame is None:
            return
        self.machine.arrived(frame)
        self.taken += [record.sequence for record in frame.messages]
        if frame.kind is FrameType.ABORT:
            self.aborted = frame.reason
        elif frame.kind is FrameType.END:
            self.acknowledgements.append(self.machine.finish({"count": len(self.taken)}, now_s))
        elif 0 <= self._fails_at < frame.end:
            self.acknowledgements.append(self.machine.fail("full", now_s))
        elif (acknowledgement := self.machine.consume(frame)) is not None:
            self.acknowledgements.append(acknowledgement)


Lose = Callable[[Action], bool]


class World:
    """A sender, its consumers, and time, which passes only where nothing else is to be done."""

    def __init__(
        self, consumers: dict[str, Consumer], *, lose: Lose = lambda action: False, batch: int = 3, offer: Offer = OFFER
    ) -> None:
        self.consumers, self._lose, self._batch = dict(consumers), lose, batch
        self.now_s = 0.0
        self.sent: list[Frame] = []
        self.asked: list[tuple[str, str]] = []
        for name, consumer in consumers.items():
            consumer.machine = receiver(name, instance=name.encode().ljust(16))
        self.sender = sender(offer, tuple(consumers), batched=batch > 1, wait_s=WAIT_S, patience_s=PATIENCE_S)

    def run(self, *, stop: Callable[[], bool] = lambda: False) -> SenderMachine:
        if self.sender.state is SenderState.GREETING and not self.asked:
            self.sender.start(self.now_s)
        for _ in range(10_000):
            if (self.sender.is_over and not self.sender.outbox) or stop():
                return self.sender
            if not (self._see_to_actions() or self._hand_over_acknowledgements() or self._send()):
                self._pass_time()
        raise AssertionError("it does not end")

    def _see_to_actions(self) -> bool:
        actions = self.sender.outbox.take()
        for action in actions:
            if isinstance(action, Publish):
                self.sent.append(action.frame)
                if not self._lose(action):
                    for consumer in self.consumers.values():
                        consumer.take(action, self.now_s)
            else:
                self.asked.append((action.consumer, action.verb))
                there = self.consumers.get(action.consumer)
                lost = there is None or self._lose(action)
                self.sender.on_answer(
                    action, None if lost or there is None else there.answer(action, self.now_s), self.now_s
                )
        return bool(actions)

    def _hand_over_acknowledgements(self) -> bool:
        found = False
        for name, consumer in self.consumers.items():
            for packet in consumer.acknowledgements:
                assert packet is not None
                self.sender.on_acknowledgement(name, packet, self.now_s)
                found = True
            consumer.acknowledgements.clear()
        return found

    def _send(self) -> bool:
        if self.sender.state is not SenderState.SENDING:
            return False
        index = self.sender.sent
        if index == COUNT:
            self.sender.end()
            return True
        return self.sender.send(tuple(message(each) for each in range(index, min(COUNT, index + self._batch))))

    def _pass_time(self) -> None:
        self.now_s = self.sender.deadline_s
        assert math.isfinite(self.now_s)
        self.sender.on_time(self.now_s)
