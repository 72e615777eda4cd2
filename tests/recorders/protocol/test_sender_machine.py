"""The sending machine beside receiving ones: it asks, sends again and goes back until all is confirmed, or fails."""

import math
from dataclasses import replace

import pytest
from sealed import KEY, receiver
from small_world import COUNT, OFFER, PATIENCE_S, WAIT_S, Consumer, World, message

from recorders.errors import WireError
from recorders.protocol.answers import Offered
from recorders.protocol.frames import MAX_PAYLOAD, FrameType
from recorders.protocol.packets import Action, Ask, Packet, Publish
from recorders.protocol.questions import ALIVE_S
from recorders.protocol.seals.opening import UnansweredError
from recorders.protocol.seals.sealing import ConsumerKeys
from recorders.protocol.states import ReceiverState, SenderState
from recorders.protocol.stream import Progress


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
    assert world.sent[0].first == 0
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
    again.machine = receiver("bob", instance=b"another instance")
    sender = world.run()
    assert sender.results == {"anna": {"count": COUNT}, "bob": {"count": COUNT - 4}}
    assert again.taken == list(range(4, COUNT))
    assert world.consumers["anna"].taken == list(range(COUNT))


def test_nothing_of_before_is_sent_again_while_a_consumer_is_greeted_anew() -> None:
    stalled: list[bool] = []

    def lose(action: Action) -> bool:
        return bool(stalled) and (isinstance(action, Publish) or action.verb == "hello")

    world = World({"anna": Consumer(), "bob": Consumer()}, lose=lose, batch=1)
    world.run(stop=lambda: world.sender.sent >= 8)
    stalled.append(True)
    world.run(stop=lambda: world.now_s >= 3.0)
    world.consumers["bob"] = again = Consumer()
    again.machine = receiver("bob", instance=b"another instance")
    world.run(stop=lambda: world.sender.state is SenderState.GREETING and not world.sender.outbox)
    before, begun_s = len(world.sent), world.now_s
    world.run(stop=lambda: world.now_s >= begun_s + 5.0)
    assert world.sender.state is SenderState.GREETING
    assert len(world.sent) == before
    stalled.clear()
    assert world.run().results == {"anna": {"count": COUNT}, "bob": {"count": COUNT}}


def with_a_consumer_that_has_lost_everything() -> World:
    """A world in the middle of a stream; the consumer is the same instance, which would never do so."""

    class Watched(Consumer):
        def answer(self, ask: Ask, now_s: float) -> Packet:
            questions.append(ask.packet)
            return super().answer(ask, now_s)

    questions: list[Packet] = []
    world = World({"anna": Watched()}, batch=1)
    world.run(stop=lambda: world.sender.consumed >= 12)
    world.consumers["anna"] = again = Consumer()
    again.machine = receiver("anna", instance=b"anna".ljust(16))
    offered = again.machine.on_hello(questions[1])
    assert isinstance(offered, Offered)
    again.machine.accept(offered, 0, world.now_s)
    return world


def test_a_consumer_that_has_lost_what_it_had_acknowledged_gets_it_again() -> None:
    world = with_a_consumer_that_has_lost_everything()
    assert world.run().results == {"anna": {"count": COUNT}}
    assert world.consumers["anna"].taken == list(range(COUNT))
    assert world.now_s < 5 * ALIVE_S


def test_a_pause_after_the_stream_has_gone_back_tries_nobodys_patience() -> None:
    world = with_a_consumer_that_has_lost_everything()
    world.run(stop=lambda: world.sender.sent == 0)
    del world.consumers["anna"]
    while world.now_s < 3 * PATIENCE_S:
        world._pass_time()
        world._see_to_actions()
    assert world.sender.state is SenderState.SENDING


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
    assert set(world.asked[2:]) == {("anna", "status")}
    assert len(world.asked) > 80  # it shows that it lives


def test_a_pause_after_the_window_was_full_tries_nobodys_patience() -> None:
    world = World({"anna": Consumer()}, batch=1)
    world.run(stop=lambda: world.sender.state is SenderState.SENDING and not world.sender.outbox)
    while world.sender.send((message(world.sender.sent),)):
        pass
    assert world.sender.sent == OFFER.window
    world._see_to_actions()
    world._hand_over_acknowledgements()
    assert world.sender.send((message(world.sender.sent),))
    world._see_to_actions()
    del world.consumers["anna"]
    while world.now_s < 3 * PATIENCE_S:
        world._pass_time()
        world._see_to_actions()
    assert world.sender.state is SenderState.SENDING


@pytest.mark.parametrize("starts", [(7,), (9, 7)])
def test_a_stream_begins_where_the_consumers_together_want_it(starts: tuple[int, ...]) -> None:
    world = World({f"consumer {start}": Consumer(start) for start in starts})
    world.run()
    assert world.sent[0].first == 7


def test_an_answer_counts_once_and_none_after_the_end() -> None:
    world = World({"anna": Consumer(), "bob": Consumer()})
    world.sender.start(0.0)
    (ask,) = world.sender.outbox.take()
    assert isinstance(ask, Ask)
    (first,) = [world.consumers["anna"].answer(ask, 0.0)]
    world.sender.on_answer(ask, first, 0.0)
    (again,) = world.sender.outbox.take()
    assert isinstance(again, Ask)
    taken = world.consumers["anna"].answer(again, 0.0)
    for _ in range(2):
        world.sender.on_answer(again, taken, 0.0)
        world.sender.exempt(again, 0.0)
    (other,) = world.sender.outbox.take()
    assert isinstance(other, Ask)
    assert (other.consumer, other.verb) == ("bob", "hello")
    world.sender.abort("enough")
    world.sender.outbox.take()
    world.sender.exempt(other, 0.0)
    world.sender.on_answer(other, None, 0.0)
    assert (world.sender.state, len(world.sender.outbox)) == (SenderState.FAILED, 0)
    failed = World({"anna": Consumer()})
    failed.sender.start(0.0)
    (ask,) = failed.sender.outbox.take()
    assert isinstance(ask, Ask)
    failed.sender.abort("enough")
    failed.sender.outbox.take()
    failed.sender.on_answer(ask, failed.consumers["anna"].answer(ask, 0.0), 0.0)
    assert not failed.sender.outbox


def test_an_offer_that_nobody_answers_is_made_again_in_a_twentieth_of_a_second() -> None:
    sender = World({"anna": Consumer()}).sender
    sender.start(0.0)
    (ask,) = sender.outbox.take()
    assert isinstance(ask, Ask)
    sender.on_answer(ask, None, 0.0)
    assert sender.deadline_s == 0.05


def test_an_answer_to_an_offer_that_cannot_be_read_is_asked_for_again() -> None:
    class Odd(Consumer):
        def answer(self, ask: Ask, now_s: float) -> Packet:
            if now_s > 0.0:
                return super().answer(ask, now_s)
            return ConsumerKeys(KEY, "anna", b"anna".ljust(16)).seals(OFFER.identity[1]).answer(ask.packet, b"odd")

    world = World({"anna": Odd()})
    assert world.run().results == {"anna": {"count": COUNT}}
    assert 0.0 < world.now_s < 1.0


def test_a_result_of_another_stream_than_was_sent_is_not_trusted() -> None:
    class Wrong(Consumer):
        def answer(self, ask: Ask, now_s: float) -> Packet:
            if self.machine.state is not ReceiverState.REPORTED:
                return super().answer(ask, now_s)
            seals = ConsumerKeys(KEY, "anna", b"anna".ljust(16)).seals(OFFER.identity[1])
            return seals.answer(ask.packet, replace(self.machine.progress, digest="00" * 32).to_json())

    error = World({"anna": Wrong()}).run().error
    assert str(error) == "anna: took in another stream than was sent; its result is not to be trusted"


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
    assert world.consumers["anna"].aborted == "the sender gave up at message 0: bob: another robot"


def test_a_consumer_that_fails_is_named_with_its_reason() -> None:
    world = World({"anna": Consumer(fails_at=5), "bob": Consumer()})
    assert str(world.run().error) == "anna: full"
    assert world.consumers["bob"].aborted.endswith(": anna: full")


def test_a_start_beyond_the_end_is_refused() -> None:
    assert "wants message 21 of a stream that has 20" in str(World({"anna": Consumer(21)}).run().error)


def test_a_stream_that_fails_is_aborted_once() -> None:
    world = World({"anna": Consumer()})
    world.run(stop=lambda: world.sender.sent >= 5)
    world.sender.abort("cut off at byte 12345")
    world.sender.abort("and again")
    sender = world.run()
    assert (sender.state, sender.error) == (SenderState.FAILED, None)
    assert world.consumers["anna"].aborted == "the sender gave up at message 6: cut off at byte 12345"
    assert sender.deadline_s == math.inf


def test_a_message_that_nobody_receives_is_refused_before_it_is_sent() -> None:
    world = World({"anna": Consumer()}, batch=1)
    world.run(stop=lambda: world.sender.state is SenderState.SENDING)
    with pytest.raises(WireError, match=f"expected at most {MAX_PAYLOAD} bytes"):
        world.sender.send((message(0)._replace(data=bytes(MAX_PAYLOAD + 1)),))
    assert not world.sender.outbox
    assert world.sender.send((message(0)._replace(data=bytes(MAX_PAYLOAD)),))


def test_what_anybody_may_publish_as_progress_counts_for_nothing() -> None:
    world = World({"anna": Consumer()}, lose=lambda action: isinstance(action, Publish))
    world.run(stop=lambda: world.sender.state is SenderState.SENDING and not world.sender.outbox)
    world.sender.send((message(0), message(1)))
    mine = Progress(OFFER.run, 1, 1)
    seals = ConsumerKeys(KEY, "anna", b"anna".ljust(16)).seals(OFFER.identity[1])
    for forged in (b"", b"{}", replace(mine, run="ff" * 16).to_json(), replace(mine, next=9, received=9).to_json()):
        world.sender.on_acknowledgement("anna", Packet(forged), 0.0)
        world.sender.on_acknowledgement("anna", seals.acknowledgement(forged), 0.0)
    world.sender.on_acknowledgement("anna", Packet(mine.to_json()), 0.0)
    assert world.sender.consumed == 0
    world.sender.on_acknowledgement("anna", seals.acknowledgement(replace(mine, result={"count": 1}).to_json()), 0.0)
    assert world.sender.consumed == 1
    assert world.sender.results == {"anna": {}}  # it has still to confirm that
    assert world.sender.deadline_s == 0.0


def test_exempt_names_are_not_waited_for() -> None:
    world = World({"anna": Consumer(), "served": Consumer()})
    del world.consumers["served"]
    world.run(stop=lambda: world.asked.count(("anna", "hello")) == 2)
    (ask,) = world.sender.outbox.take()
    assert isinstance(ask, Ask)
    assert (ask.consumer, ask.verb) == ("served", "hello")
    for _ in range(2):  # whatever comes of the question later
        world.sender.exempt(ask, world.now_s)
    world.sender.on_answer(ask, None, world.now_s)
    assert world.run().results == {"anna": {"count": COUNT}}
