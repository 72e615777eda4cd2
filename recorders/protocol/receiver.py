"""The receiving end of a stream: a machine without I/O that puts it in order and answers its sender and others."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

from recorders.errors import WireError
from recorders.protocol.frames import Frame, FrameType, stream_of, unpack
from recorders.protocol.packets import Packet
from recorders.protocol.past_streams import PastStreams
from recorders.protocol.states import RECEIVER_TRANSITIONS, ReceiverState
from recorders.protocol.stream import WINDOW_BYTES, Offer, Progress, asker, asking
from recorders.text.wording import escape_control

FAREWELL_WAIT_S = 5.0
"""How long a sender is awaited that is to fetch a result or a failure: it does within milliseconds, if it lives [s]."""

MAX_REASON = 1000  # characters of what a sender gives as its reason
GIVEN_UP = "the stream was given up"


class Offered(NamedTuple):
    """A stream on offer that the consumer is to accept or to refuse."""

    offer: Offer
    size: int  # as it came [bytes]


class ReceiverMachine:
    """Puts the frames of one stream in order, and answers its sender and others.

    Whoever drives it hands in what comes from the network and from the consumer, one call after the other, with the
    time, sends what it returns, and calls `on_time` at `deadline_s` if nothing waits to be consumed.

    Parameters
    ----------
    name : str
        Name of the consumer.
    silence_s : float
        A sender that publishes nothing at all for this long in the middle of a stream is gone [s].

    Attributes
    ----------
    state : ReceiverState
        Where it is with the stream under way.
    offer : Offer, optional
        The offer that was accepted and is not through yet.
    """

    def __init__(self, name: str, *, silence_s: float) -> None:
        self._name = name
        self._silence_s = silence_s
        self._past = PastStreams()
        self._acknowledged = 0
        self._consumed_bytes = 0  # since then
        self._last_received_s = 0.0  # when the sender was last noticed
        self._has_end = False
        self._progress = Progress()
        self._stream: tuple[bytes, bytes] | None = None  # run and sender of the stream under way
        self.state = ReceiverState.IDLE
        self.offer: Offer | None = None

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        return self._progress

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
        receiving = self.state is ReceiverState.RECEIVING
        return self._last_received_s + (self._silence_s if receiving else FAREWELL_WAIT_S)

    # From the network.

    def on_hello(self, packet: Packet) -> Packet | Offered:
        """Return the answer to an offer, or a new one, which is to be accepted or refused."""
        try:
            offer = Offer.from_json(packet.payload)
        except WireError as error:
            return Packet(Progress(error=str(error)).to_json())
        offered = Offered(offer, len(packet.payload))
        return self.answer(offered) or offered

    def answer(self, offered: Offered) -> Packet | None:
        """Return the answer to an offer that can be answered without the consumer; None if it is to decide."""
        sender = offered.offer.sender
        if self.offer is not None and self.offer.sender == sender:
            return Packet(self.progress.to_json())
        if (ended := self._past.find(sender)) is not None:
            return Packet(ended.to_json())
        return None if self.offer is None else self.refuse(offered, self.taken)

    def on_status(self, packet: Packet) -> Packet:
        """Return the answer to whoever asks how far this is; once it has gone out, `on_status_answered` is due."""
        return Packet((self._past.find(asker(packet.payload)) or self.progress).to_json())

    def on_status_answered(self, packet: Packet, answer: Packet, now_s: float) -> None:
        """Note a question that has been answered: the sender lives, and may have all that it needs.

        Anyone may ask; only the sender of the stream under way changes anything by it.
        """
        asked = packet.payload
        if self.offer is None or asked not in (asking(self.offer), asking(self.offer, farewell=True)):
            return
        self._last_received_s = now_s
        farewell = asked == asking(self.offer, farewell=True)
        is_known = answer.payload == self.progress.to_json()
        if is_known and (self.progress.error is not None or (self.progress.result is not None and farewell)):
            self._leave("fetched")

    def concerns(self, attachment: bytes) -> bool:
        """Whether an attachment is of the stream under way, or of one that is over."""
        stream = stream_of(attachment)
        return stream is not None and (stream == self._stream or self._past.find(stream[1].hex()) is not None)

    def on_sample(self, topic: str, packet: Packet, now_s: float, *, type_name: str = "") -> Frame | None:
        """Return what is new of a frame of the stream, to be queued and then noted as `arrived`.

        What came before is a repeat, what comes after a gap is sent again.

        Parameters
        ----------
        topic : str
            Topic that it came on.
        packet : Packet
            As it came; one that does not concern this is passed over.
        now_s : float
            The time [s].
        type_name : str
            Type of the message, if it is a single one on a topic of which none is known.

        Raises
        ------
        MessageError
            If it is no frame.
        """
        if self._stream is None or stream_of(packet.attachment) != self._stream:
            return None
        frame = unpack(topic, *packet, type_name=type_name)
        self._last_received_s = now_s
        if frame.kind is FrameType.ABORT:
            return self._take_abort(frame)
        received = self._progress.received
        is_end = frame.kind is FrameType.END and not self._has_end and frame.first == received
        if self.state is not ReceiverState.RECEIVING or frame.first > received or not (frame.end > received or is_end):
            return None
        return frame._replace(first=received, messages=frame.messages[received - frame.first :])

    def arrived(self, frame: Frame) -> None:
        """Note that a frame which `on_sample` returned is queued."""
        if frame.kind is FrameType.ABORT:
            self._move("sender aborted")
        else:
            self._has_end = frame.kind is FrameType.END
            self._progress = replace(self._progress, received=frame.end)

    def on_time(self, now_s: float) -> WireError | None:
        """Note that nothing came until now; returns an error if the sender is taken for gone in the middle."""
        if now_s < self.deadline_s:
            return None
        if self.state is not ReceiverState.RECEIVING:
            self._leave("sender silent")
            return None
        self._move("sender silent")
        return WireError(
            f"the sender fell silent {now_s - self._last_received_s:.0f} s ago, before message "
            f"{self._progress.received}: it was killed, or the connection is gone"
        )

    # From the consumer.

    def accept(self, offered: Offered, start: int, now_s: float) -> Packet:
        """Begin a stream from the index `start` on, and return the answer to its offer."""
        self._move("accepted")
        self.offer = offered.offer
        self._stream = offered.offer.identity
        self._progress = Progress(offered.offer.run, start, start)
        self._acknowledged, self._consumed_bytes, self._has_end = start, 0, False
        self._last_received_s = now_s
        return Packet(self.progress.to_json())

    def refuse(self, offered: Offered, reason: str) -> Packet:
        """Return the answer to an offer that is turned down."""
        return Packet(Progress(error=reason).to_json())

    def consume(self, frame: Frame) -> Packet | None:
        """Note that a frame's messages are consumed; returns an acknowledgement if it is time for one."""
        if self.offer is None or self._progress.is_final:
            return None
        self._progress = replace(self._progress, next=frame.end)
        self._consumed_bytes += frame.size
        due = frame.end - self._acknowledged >= max(1, self.offer.window // 2)
        if not due and self._consumed_bytes < WINDOW_BYTES // 4:
            return None
        self._acknowledged, self._consumed_bytes = frame.end, 0
        return Packet(self.progress.to_json())

    def finish(self, result: dict[str, Any], now_s: float) -> Packet:
        """Note the result of the stream, which is through, and return what to publish: its sender is to fetch it."""
        self._progress = replace(self._progress, result=result)
        return self._conclude("finished", now_s)

    def fail(self, reason: str, now_s: float) -> Packet:
        """Note why this consumer gives the stream up, and return what to publish: its sender is to learn it."""
        self._progress = replace(self._progress, error=reason)
        if self.state is ReceiverState.IDLE:
            return Packet(self.progress.to_json())
        return self._conclude("failed", now_s)

    def abandon(self, reason: str = GIVEN_UP) -> None:
        """Leave the stream under way, as its sender has; the answer for that sender stays."""
        if self.state is not ReceiverState.IDLE:
            self._leave("abandoned", reason)

    def gave_up(self, frame: Frame) -> WireError:
        """Return the error of a sender that aborts its stream."""
        return WireError(f"the sender gave up at message {self._progress.next}: {frame.reason}")

    def _conclude(self, event: str, now_s: float) -> Packet:
        if self.state is ReceiverState.LOST:
            self._leave(event)
        else:
            self._move(event)
            self._last_received_s = now_s
        return Packet(self.progress.to_json())

    def _take_abort(self, frame: Frame) -> Frame | None:
        if self.state in (ReceiverState.REPORTED, ReceiverState.FAILED):
            self._leave("sender aborted")  # all of it is here, or never will be: nobody waits for anything
        if self.state is not ReceiverState.RECEIVING:
            return None
        return frame._replace(reason=escape_control(frame.reason[:MAX_REASON]))

    def _leave(self, event: str, reason: str = GIVEN_UP) -> None:
        """Be idle again, and keep how the stream ended for a sender that comes back."""
        self._move(event)
        if self.offer is not None:
            self._past.keep(self.offer, self._progress, reason)
        self.offer = self._stream = None

    def _move(self, event: str) -> None:
        self.state = RECEIVER_TRANSITIONS[self.state, event]
