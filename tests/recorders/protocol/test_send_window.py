"""Both ends of a stream without a network: what is lost, late, repeated or asked twice, the stream arrives whole."""

import random

import pytest
from sealed import Sealing, receiver
from simulation.limits import lowered_limits

from recorders.messages.record import RecordedMessage
from recorders.protocol.answers import Offered
from recorders.protocol.frames import Frame, FrameType, size_of
from recorders.protocol.send_window import Rewind, SendWindow
from recorders.protocol.stream import WINDOW_BYTES, Offer, Progress, is_acknowledged
from recorders.protocol.stream_digest import StreamDigests

COUNT = 60
OFFER = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16, window=8)


def message(index: int) -> RecordedMessage:
    return RecordedMessage("/count", "", index.to_bytes(4, "little"), index, index)


def frame(index: int, size: int = 4) -> Frame:
    return Frame(FrameType.MESSAGE, *OFFER.identity, index, (message(index)._replace(data=bytes(size)),))


class Consumer:
    """A consumer at the other end of a line that loses half of what is sent, and gives the rest in any order."""

    def __init__(self, draw: random.Random) -> None:
        self._draw = draw
        self._line: list[Frame] = []
        self._machine, self._sealing = receiver(silence_s=1.0), Sealing(OFFER)
        self.taken: list[RecordedMessage] = []
        self._steps = 0
        offered = self._sealing.hello(self._machine)
        assert isinstance(offered, Offered)
        self._machine.accept(offered, 0, 0.0)
        self.hello = self._machine.progress

    def send(self, sent: Frame) -> None:
        if self._draw.random() < 0.5:
            self._line.append(sent)

    def step(self) -> Progress:
        """Take in what comes of the line, and acknowledge."""
        self._steps += 1
        assert self._steps < 10_000, "the stream does not come to its end"
        self._draw.shuffle(self._line)
        while self._line and self._draw.random() < 0.8:
            new = self._machine.on_sample(*self._sealing.frame(self._line.pop()), 0.0)
            if new is not None:
                self._machine.arrived(new)
                self.taken += new.messages
                self._machine.consume(new)
                if new.kind is FrameType.END:
                    self._machine.finish({"count": len(self.taken)}, 0.0)
        return self._machine.progress


def deliver(window: SendWindow, consumers: dict[str, Consumer], draw: random.Random) -> None:
    """Drive both ends until every consumer has its result."""
    index, digests = window.start(), StreamDigests()
    digests.begin("anna", 0)
    while not window.through:
        try:
            window.begin(index)
            for sent in (*map(frame, range(index, COUNT)), None):
                sent = sent or Frame(FrameType.END, *OFFER.identity, COUNT, digests=digests.packed())
                digests.add(sent)
                while not window.has_room(len(sent.messages), sent.size):
                    ask(window, consumers, draw)
                window.add(sent)
                for consumer in consumers.values():
                    consumer.send(sent)
            while not window.through:
                ask(window, consumers, draw)
        except Rewind as rewind:
            index = rewind.index


def ask(window: SendWindow, consumers: dict[str, Consumer], draw: random.Random) -> None:
    for name, consumer in consumers.items():
        answer = consumer.step()
        assert window.can_be(answer)
        window.note(name, answer)
        if window.lacks(answer) and draw.random() < 0.5:
            for sent in window.missing(name, answer):
                consumer.send(sent)
    window.discard_consumed()
    assert window.sent - window.consumed <= OFFER.window


@pytest.mark.parametrize("seed", range(30))
def test_every_consumer_gets_the_whole_stream_over_a_line_that_loses_half(seed: int) -> None:
    draw = random.Random(seed)
    window, consumers = SendWindow(OFFER.run, OFFER.window), {name: Consumer(draw) for name in ("anna", "bob")}
    window.progress = {name: consumer.hello for name, consumer in consumers.items()}
    deliver(window, consumers, draw)
    for consumer in consumers.values():
        assert [record.sequence for record in consumer.taken] == list(range(COUNT))
        assert [record.log_time_ns for record in consumer.taken] == list(range(COUNT))
    assert [progress.result for progress in window.progress.values()] == [{"count": COUNT}] * 2


def test_what_others_have_acknowledged_comes_from_the_stream_again() -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    for index in range(4):
        window.add(frame(index))
    window.note("anna", Progress(OFFER.run, next=3, received=4))
    assert window.discard_consumed() == 3
    assert [sent.first for sent in window.missing("anna", Progress(OFFER.run, next=3, received=3))] == [3]
    with pytest.raises(Rewind) as rewind:
        window.missing("anna", Progress(OFFER.run, next=1, received=2))
    assert rewind.value.index == 2
    assert window.progress["anna"].next == 1


def test_progress_of_others_and_of_the_past_counts_for_nothing() -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run, next=2, received=2)}
    for stranger in ("bob", "anna"):
        assert not window.note(stranger, Progress("cd" * 16, next=5, received=5))
    assert not window.note("bob", Progress(OFFER.run, next=5, received=5))
    assert not window.note("anna", Progress(OFFER.run, next=1, received=5))
    assert not window.can_be(Progress(OFFER.run, next=5, received=5))
    assert window.consumed == 2
    assert window.note("anna", Progress(OFFER.run, next=2, received=2, error="full"))
    assert not window.note("anna", Progress(OFFER.run, next=3, received=3))
    assert window.progress["anna"].error == "full"


@pytest.mark.parametrize(
    ("size", "room"), [(WINDOW_BYTES // 2, True), (WINDOW_BYTES // 2 + 1, False), (2 * WINDOW_BYTES, False)]
)
def test_no_more_than_so_many_bytes_are_under_way(size: int, room: bool) -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    assert window.has_room(1, size)  # a single one, however large
    window.add(frame(0, WINDOW_BYTES // 2))
    assert window.has_room(1, size) == room
    window.note("anna", Progress(OFFER.run, next=1, received=1))
    assert window.has_room(1, size)


@pytest.mark.parametrize(
    ("count", "size", "room"),
    [
        (1, WINDOW_BYTES // 4 - 1, True),
        (1, WINDOW_BYTES // 4, False),
        (3, 3, True),
        (4, 3, False),
        (3, WINDOW_BYTES // 4, False),
    ],
)
def test_a_frame_waits_only_for_what_consumers_acknowledge(count: int, size: int, room: bool) -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    sizes = [size - count + 1] + [1] * (count - 1)
    window.add(Frame(FrameType.BATCH, *OFFER.identity, 0, tuple(frame(0, size).messages[0] for size in sizes)))
    assert is_acknowledged(count, size, 8) != room
    assert window.has_room(8, WINDOW_BYTES) == room


def test_half_of_a_window_of_one_message_is_one() -> None:
    assert [is_acknowledged(count, 0, 1) for count in (0, 1)] == [False, True]


@pytest.mark.parametrize("seed", range(30))
def test_no_sender_waits_for_an_acknowledgement_that_is_not_due(seed: int) -> None:
    """Frames of any size go at once to consumers that take all at once, wherever in the stream each of them begins."""
    draw = random.Random(seed)
    window, sealing = SendWindow(OFFER.run, OFFER.window), Sealing(OFFER)
    machines = {name: receiver() for name in ("anna", "bob")}
    for name, machine in machines.items():
        offered = sealing.hello(machine)
        assert isinstance(offered, Offered)
        machine.accept(offered, draw.randrange(12), 0.0)
        window.progress[name] = machine.progress
    window.begin(window.start())
    most = draw.choice((8, 40, 150))
    with lowered_limits(window_bytes=120):
        while window.sent < COUNT:
            indices = range(window.sent, window.sent + draw.randint(1, OFFER.window))
            messages = tuple(frame(index, draw.randint(0, most)).messages[0] for index in indices)
            assert window.has_room(len(messages), size_of(messages))
            sent = Frame(FrameType.BATCH, *OFFER.identity, window.sent, messages)
            window.add(sent)
            for name, machine in machines.items():
                new = machine.on_sample(*sealing.frame(sent), 0.0)
                if new is not None:
                    machine.arrived(new)
                    acknowledgement = machine.consume(new)
                    if acknowledgement is not None:
                        window.note(name, Progress.from_json(acknowledgement.payload))


def test_of_a_frame_that_is_consumed_in_part_the_rest_is_under_way() -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run), "bob": Progress(OFFER.run, next=2, received=2)}
    messages = tuple(frame(index, WINDOW_BYTES // 8).messages[0] for index in range(3))
    window.add(Frame(FrameType.BATCH, *OFFER.identity, 0, messages))
    assert not window.has_room(1, WINDOW_BYTES)
    window.note("anna", Progress(OFFER.run, next=3, received=3))
    assert window.has_room(1, WINDOW_BYTES)
    (rest,) = window.missing("bob", Progress(OFFER.run, next=2, received=2))
    assert (rest.first, rest.messages) == (2, messages[2:])
    window.note("bob", Progress(OFFER.run, next=3, received=3))
    window.add(frame(3, WINDOW_BYTES // 2))
    assert window.has_room(1, WINDOW_BYTES // 2)
    assert not window.has_room(1, WINDOW_BYTES // 2 + 1)


def test_a_window_that_is_new_has_sent_nothing() -> None:
    window = SendWindow(OFFER.run, 8)
    assert (window.sent, window.consumed, window.start()) == (0, 0, 0)
    assert window.can_be(Progress(OFFER.run))
    assert not window.can_be(Progress(OFFER.run, received=1))
    assert not window.lacks(Progress(OFFER.run))


def test_so_many_messages_are_under_way_and_no_more() -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    for index in range(6):
        window.add(frame(index))
    assert window.has_room(2, 0)
    assert not window.has_room(3, 0)
    window.note("anna", Progress(OFFER.run, next=1, received=6))
    assert window.has_room(3, 0)
    window.note("anna", Progress(OFFER.run, next=6, received=6))
    assert window.has_room(100, 0)  # together, if nothing else is


def test_what_nobody_awaits_is_not_kept() -> None:
    window = SendWindow(OFFER.run, 8)
    for index in range(8):
        assert window.has_room(1, WINDOW_BYTES // 2)
        window.add(frame(index, WINDOW_BYTES // 2))
    assert window.missing("anna", Progress(OFFER.run)) == []
    assert window.consumed == 8


def test_a_stream_that_begins_again_has_nothing_under_way() -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    for index in range(3):
        window.add(frame(index, WINDOW_BYTES // 4))
    window.begin(1)
    assert window.sent == 1
    assert window.can_be(Progress(OFFER.run, received=3))  # as much was sent once
    assert window.missing("anna", Progress(OFFER.run)) == []
    for index in (1, 2):  # of which the first is then consumed
        window.add(frame(index, WINDOW_BYTES // 2))
        assert window.has_room(1, WINDOW_BYTES // 2)
        assert not window.has_room(1, WINDOW_BYTES // 2 + 1)
        window.note("anna", Progress(OFFER.run, next=index + 1, received=index + 1))


@pytest.mark.parametrize("ended", [False, True])
def test_what_a_consumer_lacks(ended: bool) -> None:
    window = SendWindow(OFFER.run, 8)
    window.progress = {"anna": Progress(OFFER.run)}
    for index in range(4):
        window.add(frame(index))
    end = [Frame(FrameType.END, *OFFER.identity, 4)] if ended else []
    for sent in end:
        window.add(sent)
    for received, following, lacks in ((3, 3, True), (4, 3, False), (4, 4, ended)):
        answer = Progress(OFFER.run, next=following, received=received)
        assert window.lacks(answer) == lacks
        assert window.missing("anna", answer) == [*(frame(index) for index in range(received, 4)), *end]
