"""State of the stream that a consumer receives: a machine of pure steps, without Zenoh, threads or a clock."""

from dataclasses import replace
from typing import Any

from recorders.errors import WireError
from recorders.text.wording import escape_control
from recorders.wire.frames import NO_RUN, Frame, FrameType
from recorders.wire.stream import WINDOW_BYTES, Offer, Progress, asker, asking

MAX_REASON = 1000  # characters of what a sender gives as its reason
_MAX_LEFT = 100  # streams that are over, of which a sender that comes back late is informed


class ReceivedStream:
    """Puts the frames of one stream in order, and knows what to answer its sender and others.

    It goes from idle, by `accept`, to a stream under way, and from there to its result or its failure; `abandon` makes
    it idle again, with the answer kept for a sender that comes back. Whoever drives it hands in what was received and
    the time, one call after the other, and sends what it returns.

    Parameters
    ----------
    name : str
        Name of the consumer.
    silence_s : float
        A sender that publishes nothing at all for this long in the middle of a stream is gone [s].

    Attributes
    ----------
    offer : Offer, optional
        The offer that was accepted and is not through yet.
    released : bool
        Whether no sender waits for an answer from here.
    """

    def __init__(self, name: str, *, silence_s: float) -> None:
        self._name = name
        self._silence_s = silence_s
        self._left: dict[str, Progress] = {}  # how streams ended that are over, by sender
        self._acknowledged = 0
        self._consumed_bytes = 0  # since then
        self._last_received_s = 0.0  # when the sender was last noticed
        self._run = ""
        self._next = self._received = 0  # stream indexes: everything before was consumed, and has arrived
        self._result: dict[str, Any] | None = None
        self._error: str | None = None
        self.offer: Offer | None = None
        self.released = True

    @property
    def progress(self) -> Progress:
        """How far the stream under way has come, or the last one."""
        return Progress(self._run, self._next, self._received, self._result, self._error)

    @property
    def taken(self) -> str:
        """The reason to refuse an offer while another stream is under way."""
        return f"{self._name} is already fed by another replay"

    @property
    def under_way(self) -> bool:
        """Whether messages of a stream are awaited."""
        return self.offer is not None and not self.progress.is_final

    def answer_hello(self, offer: Offer) -> Progress | None:
        """Return the answer to an offer; None for a new one, which is to be accepted or refused."""
        if self.offer is not None and self.offer.sender == offer.sender:
            return self.progress
        if offer.sender in self._left:
            return self._left[offer.sender]
        return None if self.offer is None else Progress(error=self.taken)

    def accept(self, offer: Offer, start: int, now_s: float) -> Progress:
        """Begin a stream from the index `start` on, and return the answer to its offer."""
        self.offer = offer
        self._run, self._next, self._received = offer.run, start, start
        self._result = self._error = None
        self._acknowledged, self._consumed_bytes = start, 0
        self._last_received_s = now_s
        self.released = False
        return self.progress

    def owns(self, frame: Frame) -> bool:
        """Whether a frame is of the stream under way."""
        return self.offer is not None and (frame.run, frame.sender) == self.offer.identity

    def has_left(self, frame: Frame) -> bool:
        """Whether a frame is of a stream that is over; its sender learns so when it asks."""
        return frame.sender.hex() in self._left

    def take(self, frame: Frame, now_s: float) -> Frame | None:
        """Return what is new of a frame of the stream, to be queued and then noted as `arrived`.

        What came before is a repeat, what comes after a gap is sent again.
        """
        self._last_received_s = now_s
        if frame.kind is FrameType.ABORT:
            return self._take_abort(frame)
        received = self._received
        new = frame.end > received or (frame.kind is FrameType.END and frame.first == received)
        if not new or frame.first > received:
            return None
        return frame._replace(first=received, messages=frame.messages[received - frame.first :])

    def arrived(self, frame: Frame) -> None:
        """Note that a frame which `take` returned is queued."""
        if frame.kind is not FrameType.ABORT:
            self._received = frame.end

    def consume(self, frame: Frame) -> bool:
        """Note that a frame's messages are consumed; True if an acknowledgement is due."""
        self._next = frame.end
        self._consumed_bytes += frame.size
        if self.offer is None:
            return False
        due = frame.end - self._acknowledged >= max(1, self.offer.window // 2)
        if not due and self._consumed_bytes < WINDOW_BYTES // 4:
            return False
        self._acknowledged, self._consumed_bytes = frame.end, 0
        return True

    def finish(self, result: dict[str, Any], now_s: float) -> None:
        """Note the result of the stream, which is through; its sender is awaited to fetch it."""
        self._last_received_s = now_s
        self._result = result

    def fail(self, reason: str) -> None:
        """Note why this consumer gives the stream up; its sender is awaited to fetch it."""
        self._error = reason

    def abandon(self, reason: str = "the stream was given up") -> None:
        """Leave the stream under way, as its sender has; the answer for that sender stays."""
        if self.offer is not None and bytes.fromhex(self.offer.sender) != NO_RUN:  # live messages are of no sender
            self._remember(self.offer.sender, reason)
        self.offer = None
        self.released = True

    def gave_up(self, frame: Frame) -> WireError:
        """Return the error of a sender that aborts its stream; it waits for nothing more."""
        self.released = True
        return WireError(f"the sender gave up at message {self._next}: {frame.reason}")

    def answer_status(self, asked: bytes) -> Progress:
        """Return the answer to whoever asks how far this is."""
        return self._left.get(asker(asked), self.progress)

    def note_status(self, asked: bytes, answered: Progress, now_s: float) -> None:
        """Note a question that has been answered: the sender lives, and may have all that it needs.

        Anyone may ask; only the sender of the stream under way changes anything by it.
        """
        if self.offer is None or asked not in (asking(self.offer), asking(self.offer, farewell=True)):
            return
        self._last_received_s = now_s
        farewell = asked == asking(self.offer, farewell=True)
        if answered.error is not None or (answered.result is not None and farewell):
            self.abandon()

    def silence_s(self, now_s: float) -> float:
        """Return for how long nothing has come from the sender [s]."""
        return now_s - self._last_received_s

    def check_silence(self, now_s: float) -> None:
        """Check that the sender of the stream under way is not gone.

        Raises
        ------
        WireError
            If it has been silent for too long in the middle of the stream.
        """
        silent_s = self.silence_s(now_s)
        if self.under_way and silent_s > self._silence_s:
            self.released = True
            raise WireError(
                f"the sender fell silent {silent_s:.0f} s ago, before message {self._received}: "
                "it was killed, or the connection is gone"
            )

    def _take_abort(self, frame: Frame) -> Frame | None:
        if self._result is not None:
            self.abandon()  # all of it is here; somebody else who was awaited has failed
            return None
        return frame._replace(reason=escape_control(frame.reason[:MAX_REASON]))

    def _remember(self, sender: str, reason: str) -> None:
        """Keep how a stream ended, for as many as there is room."""
        progress = self.progress
        self._left[sender] = progress if progress.is_final else replace(progress, error=reason)
        while len(self._left) > _MAX_LEFT:
            del self._left[next(iter(self._left))]
