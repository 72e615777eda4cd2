"""The receiving end of a stream: a machine without I/O that puts it in order and answers its sender and others."""

import math
from collections.abc import Callable
from typing import Any

from recorders.errors import WireError
from recorders.protocol.answers import Answers, Offered
from recorders.protocol.frames import Frame, FrameType, stream_of
from recorders.protocol.incoming import IncomingStream
from recorders.protocol.known_streams import KnownStreams
from recorders.protocol.packets import Packet
from recorders.protocol.seals.sealing import ConsumerKeys, question_number
from recorders.protocol.states import RECEIVER_TRANSITIONS, ReceiverState
from recorders.protocol.stream import Offer, Progress, asker, asking

FAREWELL_WAIT_S = 5.0
"""How long a sender is awaited that is to fetch a result or a failure: it does within milliseconds, if it lives [s]."""

GIVEN_UP = "the stream was given up"


class ReceiverMachine:
    """Puts the frames of one stream in order, and answers its sender and others.

    Whoever drives it hands in what comes from the network and from the consumer, one call after the other, with the
    time, sends what it returns, and calls `on_time` at `deadline_s` if nothing waits to be consumed.

    Parameters
    ----------
    name : str
        Name of the consumer.
    key : bytes
        The key that it shares with its senders.
    instance : bytes
        16 bytes that are fresh whenever a consumer starts.
    silence_s : float
        A sender that publishes nothing at all for this long in the middle of a stream is gone [s].
    refuse : callable
        Takes what it was and why, of what is not authentic.

    Attributes
    ----------
    state : ReceiverState
        Where it is with the stream under way.
    """

    def __init__(
        self,
        name: str,
        *,
        key: bytes,
        instance: bytes,
        silence_s: float,
        refuse: Callable[[str, str], None] = lambda topic, reason: None,
    ) -> None:
        self._name = name
        self._silence_s = silence_s
        self._streams = KnownStreams()
        self._answers = Answers(ConsumerKeys(key, name, instance), self._streams, refuse)
        self._last_received_s = 0.0  # when the sender was last noticed
        self.state = ReceiverState.IDLE

    @property
    def offer(self) -> Offer | None:
        """The offer that was accepted and is not through yet."""
        stream = self._streams.current
        return None if stream is None else stream.offer

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        return self._streams.progress

    @property
    def released(self) -> bool:
        """Whether no sender waits for an answer from here."""
        return self.state in (ReceiverState.IDLE, ReceiverState.LOST)

    @property
    def taken(self) -> str:
        """The reason to refuse an offer while another stream is under way."""
        return f"{self._name} is already fed by another replay"

    @property
    def deadline_s(self) -> float:
        """When the sender is taken for gone, if nothing comes from it before [s]; infinite if none is awaited."""
        if self.released:
            return math.inf
        if self._streams.given_up:
            return -math.inf
        receiving = self.state is ReceiverState.RECEIVING
        return self._last_received_s + (self._silence_s if receiving else FAREWELL_WAIT_S)

    # From the network.

    def on_hello(self, packet: Packet) -> Packet | Offered:
        """Return the answer to an offer, or a new one, to be queued and then noted as `waiting`."""
        return self._answers.to_hello(packet, self.taken)

    def waiting(self, offered: Offered) -> None:
        """Note that an offer which `on_hello` returned is queued, to be accepted or refused."""
        self._streams.offer(offered.offer, offered.seals)

    def answer(self, offered: Offered) -> Packet | None:
        """Return the answer to an offer that can be answered by now without the consumer; None if it is to decide."""
        return self._answers.to_offer(offered, self.taken)

    def on_status(self, packet: Packet) -> Packet:
        """Return the answer to whoever asks how far this is; once it has gone out, `on_status_answered` is due."""
        return self._answers.to_status(packet)

    def on_status_answered(self, packet: Packet, answer: Packet, now_s: float) -> None:
        """Note a question that has been answered: the sender lives, and may have all that it needs."""
        stream = self._streams.current
        if stream is None or not answer.attachment or asker(packet.payload) != stream.offer.sender:
            return
        self._notice(stream, question_number(packet), now_s)
        farewell = packet.payload == asking(stream.offer, farewell=True)
        may_leave = stream.error is not None or (stream.result is not None and farewell)
        if may_leave and answer.payload == stream.progress.to_json():
            self._leave("fetched")

    def concerns(self, attachment: bytes) -> bool:
        """Whether an attachment is of the stream under way, or of one that is over."""
        return self._streams.concerns(attachment)

    def on_sample(self, topic: str, packet: Packet, now_s: float, *, type_name: str = "") -> Frame | None:
        """Return what is new of a frame of the stream, to be queued and then noted as `arrived`.

        Parameters
        ----------
        topic : str
            Topic that it came on.
        packet : Packet
            As it came; one that is not of the stream under way is passed over.
        now_s : float
            The time [s].
        type_name : str
            Type of the message, if it is a single one on a topic of which none is known.

        Raises
        ------
        MessageError
            If it is not the sender's, or no frame.
        """
        stream, identity = self._streams.current, stream_of(packet.attachment)
        if stream is None or identity != stream.identity:
            if identity in self._streams.offered:
                self._streams.offered[identity].note_abort(topic, packet, type_name)
            return None
        frame, number = stream.opened(topic, packet, type_name)
        self._notice(stream, number, now_s)
        if frame.kind is FrameType.ABORT and self.state in (ReceiverState.REPORTED, ReceiverState.FAILED):
            self._leave("sender aborted")  # all of it is here, or never will be: nobody waits for anything
        if self.state is not ReceiverState.RECEIVING:
            return None
        if frame.kind is FrameType.ABORT:
            return frame._replace(reason=stream.aborted(frame), digests=b"")
        return stream.new_part(frame, packet.payload)

    def arrived(self, frame: Frame) -> None:
        """Note that a frame which `on_sample` returned is queued."""
        stream = self._streams.current
        if stream is None:
            return
        if frame.kind is not FrameType.ABORT:
            stream.arrived(frame)
        elif not frame.digests:
            self._move("sender aborted")
        else:  # an end of another stream than the one that arrived, which its sender is to learn
            stream.error = frame.reason
            self._move("failed")

    def on_time(self, now_s: float) -> WireError | None:
        """Note that nothing came until now; returns an error if the sender is taken for gone in the middle."""
        if now_s < self.deadline_s:
            return None
        if self.state is not ReceiverState.RECEIVING:
            self._leave("sender silent")
            return None
        self._move("sender silent")
        return WireError(
            self._streams.given_up
            or f"the sender fell silent {now_s - self._last_received_s:.0f} s ago, before message "
            f"{self.progress.received}: it was killed, or the connection is gone"
        )

    # From the consumer.

    def accept(self, offered: Offered, start: int, now_s: float) -> Packet:
        """Begin a stream from the index `start` on, and return the answer to its offer."""
        self._move("accepted")
        self._streams.begin(IncomingStream(offered.offer, offered.seals, start))
        self._last_received_s = now_s
        return offered.answer(self.progress)

    def refuse(self, offered: Offered, reason: str) -> Packet:
        """Return the answer to an offer that is turned down."""
        return self._answers.refusal(offered, reason)

    def consume(self, frame: Frame) -> Packet | None:
        """Note that a frame's messages are consumed; returns an acknowledgement if it is time for one."""
        stream = self._streams.current
        if stream is None or stream.is_final or not stream.consume(frame):
            return None
        return stream.seals.acknowledgement(stream.progress.to_json())

    def finish(self, result: dict[str, Any], now_s: float) -> Packet | None:
        """Note the result of the stream, which is through, and return what to publish: its sender is to fetch it."""
        if self._streams.current is not None:
            self._streams.current.result = result
        return self._conclude("finished", now_s)

    def fail(self, reason: str, now_s: float) -> Packet | None:
        """Note why this consumer gives the stream up, and return what to publish: its sender is to learn it."""
        if self._streams.current is not None:
            self._streams.current.error = reason
        return self._conclude("failed", now_s)

    def abandon(self, reason: str = GIVEN_UP) -> None:
        """Leave the stream under way, as its sender has; the answer for that sender stays."""
        if self._streams.current is not None:
            self._leave("abandoned", reason)

    def _conclude(self, event: str, now_s: float) -> Packet | None:
        stream = self._streams.current
        if stream is None:
            return None
        if self.state is ReceiverState.LOST:
            self._leave(event)
        else:
            self._move(event)
            self._last_received_s = now_s
        return stream.seals.acknowledgement(stream.progress.to_json())

    def _notice(self, stream: IncomingStream, number: int, now_s: float) -> None:
        if stream.is_news(number):
            self._last_received_s = now_s

    def _leave(self, event: str, reason: str = GIVEN_UP) -> None:
        """Be idle again, and keep how the stream ended for a sender that comes back."""
        self._move(event)
        self._streams.close(reason)
        self._answers.renew()

    def _move(self, event: str) -> None:
        self.state = RECEIVER_TRANSITIONS[self.state, event]
