"""The sending end of a stream: a machine without I/O that greets, sends, sends again, and fetches the results."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import FrameType, size_of
from recorders.protocol.outbox import Outbox
from recorders.protocol.packets import Ask, Packet, read_progress
from recorders.protocol.patience import Patience
from recorders.protocol.questions import Questions
from recorders.protocol.seals.opening import Opening
from recorders.protocol.seals.sealing import SenderSeals, instance_of
from recorders.protocol.send_window import Rewind, SendWindow
from recorders.protocol.states import SENDER_TRANSITIONS, SenderState
from recorders.protocol.stream import Offer, Progress, asking


class SenderMachine:
    """Delivers one stream to its consumers: whole, in order, and confirmed by their results, or not at all.

    Whoever drives it hands in what happens and the time, one call after the other, sees to what `outbox` holds,
    and calls `on_time` at `deadline_s`. While it is SENDING it takes the stream from index `sent` on, which falls where
    a consumer lacks what is not here any longer, or was started anew.

    Parameters
    ----------
    offer : Offer
        The stream, with a sender of its own and the window.
    consumers : sequence of str
        Who is awaited; the window is the slowest one's.
    key : bytes
        The key that all of them share.
    batched : bool
        Whether messages travel in batches, or each on its own topic.
    wait_s : float
        How long a consumer may take to appear, and once it has, to decide [s].
    patience_s : float
        How long a consumer may leave every question unanswered, or receive nothing of what is sent [s].
    refuse : callable
        Takes key and reason of what is not authentic.

    Attributes
    ----------
    state : SenderState
        Where it is on its way.
    error : WireError, optional
        Why it has failed; None if it was aborted from outside.
    outbox : Outbox
        What is to be done.
    """

    def __init__(
        self,
        offer: Offer,
        consumers: tuple[str, ...],
        *,
        key: bytes,
        batched: bool,
        wait_s: float,
        patience_s: float,
        refuse: Callable[[str, str], None] = lambda topic, reason: None,
    ) -> None:
        self._offer = offer
        self._kind, self._wait_s = FrameType.BATCH if batched else FrameType.MESSAGE, wait_s
        self._window = SendWindow(offer.run, offer.window)
        self._questions = Questions(consumers, wait_s)
        self._patience = Patience(patience_s)
        self._seals = SenderSeals(key, offer.identity[1])
        self.outbox = Outbox(offer, self._seals)
        self._opening = Opening(self._seals, refuse)
        self.state = SenderState.GREETING
        self.error: WireError | None = None

    @property
    def sent(self) -> int:
        """The index of the next message to send."""
        return self._window.sent

    @property
    def consumed(self) -> int:
        """The index up to which every consumer has consumed."""
        return self._window.consumed

    @property
    def results(self) -> dict[str, dict[str, Any]]:
        """The result of each consumer by its name."""
        return {name: progress.result or {} for name, progress in self._window.progress.items()}

    @property
    def is_over(self) -> bool:
        """Whether nothing happens any more."""
        return self.state in (SenderState.DONE, SenderState.FAILED)

    @property
    def deadline_s(self) -> float:
        """When `on_time` is to be called, if nothing happens before [s]; infinite if never."""
        return math.inf if self.is_over else self._questions.deadline_s

    def start(self, now_s: float) -> None:
        """Begin to greet."""
        self._greet_next(now_s)

    def send(self, messages: tuple[RecordedMessage, ...]) -> bool:
        """Send the messages from index `sent` on; False if they have to wait for room, and are to be sent again.

        Raises
        ------
        WireError
            If one is larger than anybody receives.
        """
        if not self._window.has_room(len(messages), size_of(messages)):
            self._patience.begin()
            return False
        self._patience.end()
        self._window.add(self.outbox.publish(self._kind, self.sent, messages))
        return True

    def end(self) -> None:
        """Note that the stream has no more messages: `sent` is its end."""
        self._window.add(self.outbox.publish(FrameType.END, self.sent))
        self._move("ended")
        self._patience.begin()
        self._conclude()

    def abort(self, reason: str) -> None:
        """Give the stream up, and inform the consumers that may have taken the offer."""
        if not self.is_over:
            self.outbox.publish(FrameType.ABORT, self.sent, reason=reason)
            self._move("failed")

    def on_time(self, now_s: float) -> None:
        """Ask whom it is time to ask, and give up if who is greeted has taken too long."""
        if self._questions.has_waited(now_s):
            self._fail(self._opening.unanswered(self._questions.ungreeted[0], self._wait_s))
        for name, verb in () if self.is_over else self._questions.take_due(now_s):
            self._ask(name, verb, self._offer.to_json() if verb == "hello" else asking(self._offer))

    def on_acknowledgement(self, consumer: str, packet: Packet, now_s: float) -> None:
        """Take in what was published as a consumer's progress; that it is through counts once it has confirmed it."""
        progress = self._opening.acknowledgement(consumer, packet)
        if progress is None or progress.run != self._offer.run or not self._window.can_be(progress):
            return
        if progress.is_final:
            self._questions.confirm(consumer, now_s)
            progress = replace(progress, result=None, error=None)
        self._window.note(consumer, progress)

    def awaits(self, ask: Ask) -> bool:
        """Whether the answer to a question is still awaited."""
        return self._questions.is_open(ask) and not self.is_over

    def on_answer(self, ask: Ask, packet: Packet | None, now_s: float) -> None:
        """Take in an answer to a question; None if no more can come. One that is not the consumer's answers nothing."""
        if not self.awaits(ask) or (packet is not None and not self._opening.is_answer(ask, packet)):
            return
        self._questions.close(ask)
        if ask.verb == "hello":
            self._take_hello(ask.consumer, packet, now_s)
        elif self.state is SenderState.LEAVING:
            self._conclude()
        else:
            self._take_status(ask.consumer, None if packet is None else read_progress(packet), now_s)

    def exempt(self, ask: Ask, now_s: float) -> None:
        """Take in that whoever has the name that was greeted acknowledges nothing, and need not be greeted."""
        if self.awaits(ask):
            self._questions.ungreeted.remove(ask.consumer)
            self._greet_next(now_s)

    def _greet_next(self, now_s: float) -> None:
        if not self._questions.greet_next(now_s):
            self._window.begin(self._window.start())
            self._move("greeted")
        self.on_time(now_s)

    def _take_hello(self, name: str, packet: Packet | None, now_s: float) -> None:
        answer = None if packet is None else read_progress(packet)
        if packet is None or answer is None:
            self._questions.greet_later(now_s)
        elif answer.error is not None:
            self._fail(WireError(f"{name}: {answer.error}"))
        elif answer.run != self._offer.run:  # an offer to another instance is not taken
            self._questions.greet_instance(instance_of(packet), now_s)
        elif self._offer.messages is not None and answer.next > self._offer.messages:
            self._fail(WireError(f"{name}: wants message {answer.next} of a stream that has {self._offer.messages}"))
        else:
            self._window.progress[name] = answer
            self.outbox.digests.begin(name, answer.next)
            self._questions.has_accepted(name, now_s)
            self._greet_next(now_s)
        self.on_time(now_s)

    def _take_status(self, name: str, answer: Progress | None, now_s: float) -> None:
        self._questions.ask_later(name, now_s)
        if self._window.progress[name].result is not None:
            return
        if answer is not None and answer.run != self._offer.run:  # it was started anew
            self._move("consumer restarted")
            self._patience.end()  # nothing of before is sent again: the stream goes on from where this one wants it
            if self._questions.has_restarted(name):
                self._greet_next(now_s)
        elif answer is not None and answer.error is not None:
            self._fail(WireError(f"{name}: {answer.error}"))
        elif answer is not None and answer.result is not None and answer.digest != self.outbox.digests.digest(name):
            self._fail(WireError(f"{name}: took in another stream than was sent; its result is not to be trusted"))
        else:
            if answer is not None:
                self._window.note(name, answer)
            if self._patience.is_tried and self._window.progress[name].result is None:
                self._send_missing(name, answer, now_s)
            self._conclude()
        self.on_time(now_s)

    def _send_missing(self, name: str, answer: Progress | None, now_s: float) -> None:
        """Send again what a consumer has lacked twice in a row; go back for what is not here any longer."""
        lacking, received = (True, None) if answer is None else (self._window.lacks(answer), answer.received)
        try:
            if self._patience.lacks(name, received, now_s, lacking=lacking) and answer is not None:
                for frame in self._window.missing(name, answer):
                    self.outbox.publish_again(frame)
        except Rewind as rewind:
            self._window.begin(rewind.index)
            self._move("rewound")
            self._patience.end()
        except WireError as error:
            self._fail(error)

    def _conclude(self) -> None:
        """Say farewell once all results are there, and be done once everybody has answered."""
        if self.state is SenderState.ENDING and self._window.through:
            self._move("all reported")
            for name in self._questions.take_accepted():
                self._ask(name, "status", asking(self._offer, farewell=True))
        if self.state is SenderState.LEAVING and self._questions.are_all_answered:
            self._move("all know")

    def _fail(self, error: WireError) -> None:
        if not self.is_over:
            self.error = error
            self.abort(str(error))

    def _move(self, event: str) -> None:
        self.state = SENDER_TRANSITIONS[self.state, event]

    def _ask(self, name: str, verb: str, payload: bytes) -> None:
        self.outbox.ask(self._questions.ask(name, verb, self._seals.question(name, verb, payload)))
