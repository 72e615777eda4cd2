"""The sending machine beside receiving ones: it asks, sends again and goes back until all is confirmed, or fails."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import MAX_PAYLOAD, Frame, FrameType
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.questions import ALIVE_S
from recorders.protocol.receiver import Offered, ReceiverMachine
from recorders.protocol.sender import SenderMachine, UnansweredError
from recorders.protocol.states import SenderState
from recorders.protocol.stream import Offer, Progress

COUNT = 20
OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8, messages=COUNT)
WAIT_S, PATIENCE_S = 10.0, 30.0


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


class Consumer:
    """A consumer in the same process that consumes at once; `start` is where it goes on."""

    def __init__(self, start: int = 0, *, refuses: str = "", fails_at: int = -1) -> None:
        self._start, self._refuses, self._fails_at = start, refuses, fails_at
        self.machine = ReceiverMachine("learner", silence_s=30.0)
        self.taken: list[int] = []
        self.aborted = ""
        self.acknowledgements: list[Packet] = []

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
        self.sender = SenderMachine(offer, tuple(consumers), batched=batch > 1, wait_s=WAIT_S, patience_s=PATIENCE_S)

    def run(self, *, stop: Callable[[], bool] = lambda: False) -> SenderMachine:
        if self.sender.state is SenderState.GREETING and not self.asked:
            self.sender.start(self.now_s)
        for _ in range(10_000):
            if (self.sender.is_over and not self.sender.has_actions) or stop():
                return self.sender
            if not (self._see_to_actions() or self._hand_over_acknowledgements() or self._send()):
                self._pass_time()
        raise AssertionError("it does not end")

    def _see_to_actions(self) -> bool:
        actions = self.sender.take_actions()
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


@pytest.mark.parametrize("batch", [1, 3])
def test_everything_is_delivered_to_everybody_from_where_each_wants_it(batch: int) -> None:
    world = World({"anna": Consumer(), "bob": Consumer(7), "carl": Consumer(COUNT)}, batch=batch)
    sender = world.run()
    assert sender.state is SenderState.DONE
    assert sender.results == {"anna": {"count": 20}, "bob": {"count": 13}, "carl": {"count": 0}}
    assert [consumer.taken for consumer in world.consumers.values()] == [
        list(range(start, COUNT)) for start in (0, 7, COUNT)
    ]
    assert all(consumer.machine.released for consumer in world.consumers.values())
    assert world.now_s == 0.0  # nothing was ever waited for


def test_a_stream_that_nobody_awaits_goes_out_at_once() -> None:
    world = World({})
    assert world.run().state is SenderState.DONE
    assert world.sent[-1].kind is FrameType.END
    assert world.asked == []


def test_what_a_consumer_lacks_twice_is_sent_again() -> None:
    lost: list[int] = []

    def lose(action: Action) -> bool:
        if isinstance(action, Publish) and action.frame.first >= 6 and len(lost) < 2:
            lost.append(action.frame.first)
            return True
        return False

    world = World({"anna": Consumer()}, lose=lose)
    assert world.run().results == {"anna": {"count": COUNT}}
    assert lost == [6, 9]
    assert world.now_s == pytest.approx(2 * ALIVE_S)
    firsts = [frame.first for frame in world.sent]
    assert firsts.count(6) == 2


def test_the_end_is_sent_again() -> None:
    lost: list[Action] = []

    def lose(action: Action) -> bool:
        if isinstance(action, Publish) and action.frame.kind is FrameType.END and not lost:
            lost.append(action)
            return True
        return False

    assert World({"anna": Consumer()}, lose=lose).run().results == {"anna": {"count": COUNT}}
    assert len(lost) == 1


def test_a_consumer_that_was_started_anew_is_greeted_anew_and_gets_the_stream_from_where_it_goes_on() -> None:
    world = World({"anna": Consumer(), "bob": Consumer()})
    world.run(stop=lambda: world.sender.sent >= 15)
    world.consumers["bob"] = again = Consumer(4)
    sender = world.run()
    assert sender.results == {"anna": {"count": COUNT}, "bob": {"count": COUNT - 4}}
    assert again.taken == list(range(4, COUNT))
    assert world.consumers["anna"].taken == list(range(COUNT))


def test_a_consumer_that_is_gone_tries_the_senders_patience() -> None:
    world = World({"anna": Consumer()})
    world.run(stop=lambda: world.sender.sent >= 9)
    begin_s = world.now_s
    del world.consumers["anna"]
    assert str(world.run().error) == "anna: no answer for 30 s; the rest of the stream is unconfirmed"
    assert world.now_s - begin_s >= PATIENCE_S
    assert world.sent[-1].kind is FrameType.ABORT


def test_a_pause_of_the_stream_tries_nobodys_patience() -> None:
    world = World({"anna": Consumer()})
    world.run(stop=lambda: world.sender.state is SenderState.SENDING)
    world.sender.send((message(0),))
    world._see_to_actions()
    del world.consumers["anna"]
    while world.now_s < 3 * PATIENCE_S:
        world._pass_time()
        world._see_to_actions()
    assert world.sender.state is SenderState.SENDING
    assert set(world.asked[1:]) == {("anna", "status")}
    assert len(world.asked) > 80  # it shows that it lives


def test_nobody_of_the_name_is_one_clear_error() -> None:
    world = World({"anna": Consumer()})
    del world.consumers["anna"]
    error = world.run().error
    assert isinstance(error, UnansweredError)
    assert (str(error), error.consumer) == ("no consumer named 'anna' answered within 10 s", "anna")
    assert world.now_s > WAIT_S


def test_who_accepted_learns_that_another_refuses() -> None:
    world = World({"anna": Consumer(), "bob": Consumer(refuses="another robot")})
    assert str(world.run().error) == "bob: another robot"
    assert world.consumers["anna"].aborted == "bob: another robot"


def test_a_consumer_that_fails_is_named_with_its_reason() -> None:
    world = World({"anna": Consumer(fails_at=5), "bob": Consumer()})
    assert str(world.run().error) == "anna: full"
    assert world.consumers["bob"].aborted == "anna: full"


def test_a_start_beyond_the_end_is_refused() -> None:
    assert "wants message 21 of a stream that has 20" in str(World({"anna": Consumer(21)}).run().error)


def test_a_stream_that_fails_is_aborted_once() -> None:
    world = World({"anna": Consumer()})
    world.run(stop=lambda: world.sender.sent >= 5)
    world.sender.abort("cut off at byte 12345")
    world.sender.abort("and again")
    sender = world.run()
    assert (sender.state, sender.error) == (SenderState.FAILED, None)
    assert world.consumers["anna"].aborted == "cut off at byte 12345"
    assert sender.deadline_s == math.inf


def test_a_message_that_nobody_receives_is_refused_before_it_is_sent() -> None:
    world = World({"anna": Consumer()})
    world.run(stop=lambda: world.sender.state is SenderState.SENDING)
    with pytest.raises(WireError, match=f"expected at most {MAX_PAYLOAD} bytes"):
        world.sender.send((message(0)._replace(data=bytes(MAX_PAYLOAD + 1)),))
    assert not world.sender.has_actions


def test_what_anybody_may_publish_as_progress_counts_for_nothing() -> None:
    world = World({"anna": Consumer()}, lose=lambda action: isinstance(action, Publish))
    world.run(stop=lambda: world.sender.state is SenderState.SENDING and not world.sender.has_actions)
    world.sender.send((message(0), message(1)))
    mine = Progress(OFFER.run, 1, 1)
    for forged in (b"", b"{}", replace(mine, run="ff" * 16).to_json(), replace(mine, next=9, received=9).to_json()):
        world.sender.on_acknowledgement("anna", Packet(forged), 0.0)
    assert world.sender.consumed == 0
    world.sender.on_acknowledgement("anna", Packet(replace(mine, result={"count": 1}).to_json()), 0.0)
    assert world.sender.results == {"anna": {}}  # it has still to confirm that
    assert world.sender.deadline_s == 0.0


def test_exempt_names_are_not_waited_for() -> None:
    world = World({"anna": Consumer(), "served": Consumer()})
    del world.consumers["served"]
    world.run(stop=lambda: ("anna", "hello") in world.asked)
    (ask,) = world.sender.take_actions()
    assert isinstance(ask, Ask)
    assert (ask.consumer, ask.verb) == ("served", "hello")
    world.sender.exempt(ask, world.now_s)
    assert world.run().results == {"anna": {"count": COUNT}}
