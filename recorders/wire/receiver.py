"""The receiving end of a stream: says hello, puts frames in order, acknowledges what was consumed."""

import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh

from recorders.errors import MessageError, ReenactError, WireError
from recorders.records import Stamped
from recorders.stream import Consumer, Offer, Progress
from recorders.wire.frames import DEFAULT_NAMESPACE, Frame, Kind, control_key, unpack

MAX_PAYLOAD = 16 << 20
"""Larger payloads are refused unread [bytes]; a batch of 64 joint states is some 30 KB."""

FAREWELL = b"farewell"
_FAREWELL_WAIT_S = 5.0  # the sender confirms the result within milliseconds, if it still lives


@dataclass(frozen=True)
class ReceiverConfig:
    """How a receiver is known, and how long it waits.

    Parameters
    ----------
    name : str
        The name that a sender awaits.
    namespace : str
        First part of every key.
    silence_s : float
        A sender that says nothing at all for this long in the middle of a stream is gone [s].
    """

    name: str = "learner"
    namespace: str = DEFAULT_NAMESPACE
    silence_s: float = 30.0


class Receiver:
    """Receives one stream over Zenoh for a consumer.

    Zenoh calls back on threads of its own; they only check a frame's place and queue it. Everything else happens on
    the caller's thread, in `serve`.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : ReceiverConfig
        Name, namespace and patience.
    warn : callable
        Told, in one line, of every offer that is refused.
    """

    def __init__(
        self,
        session: zenoh.Session,
        *,
        config: ReceiverConfig | None = None,
        warn: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._session = session
        self._config = config or ReceiverConfig()
        self._warn = warn
        self._lock = threading.Lock()
        self._offers: queue.SimpleQueue[tuple[Offer, zenoh.Query]] = queue.SimpleQueue()
        self._frames: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._farewell = threading.Event()
        self._offer: Offer | None = None  # the one accepted
        self._progress = Progress()
        self._last_heard_s = time.monotonic()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Declare the subscriber first: whoever gets an answer to hello can rely on it."""
        name, namespace = self._config.name, self._config.namespace
        enter = self._stack.enter_context
        enter(
            self._session.declare_subscriber(f"{namespace}/**", self._on_sample, allowed_origin=zenoh.Locality.REMOTE)
        )
        self._ack = enter(
            self._session.declare_publisher(
                control_key(namespace, name, "ack"), congestion_control=zenoh.CongestionControl.BLOCK
            )
        )
        enter(self._session.declare_queryable(control_key(namespace, name, "status"), self._on_status))
        enter(self._session.declare_queryable(control_key(namespace, name, "hello"), self._on_hello))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Undeclare everything; the session stays open."""
        self._stack.close()

    def serve(self, consumer: Consumer, *, wait_s: float = math.inf) -> dict[str, Any]:
        """Wait for an offer that the consumer takes, feed it the stream, and return its result.

        Parameters
        ----------
        consumer : Consumer
            Takes the messages, in order and without a gap.
        wait_s : float
            How long to wait for the first accepted offer [s]; for ever if left out.

        Raises
        ------
        WireError
            If no offer came, or the sender failed or fell silent.
        ReenactError
            Whatever the consumer raised; the sender is told.
        """
        offer = self._accept(consumer, wait_s)
        try:
            result = consumer.consume(self._messages(stride=max(1, offer.window // 2)))
        except BaseException as error:
            reason = str(error) if isinstance(error, ReenactError) else f"stopped by {type(error).__name__}"
            self._report(error=reason)
            raise
        self._report(result=result)
        self._farewell.wait(_FAREWELL_WAIT_S)
        return result

    def _accept(self, consumer: Consumer, wait_s: float) -> Offer:
        deadline = time.monotonic() + wait_s
        while True:
            try:
                offer, query = self._offers.get(
                    timeout=max(0.0, min(threading.TIMEOUT_MAX, deadline - time.monotonic()))
                )
            except queue.Empty:
                raise WireError(f"{self._config.name}: nobody offered a stream within {wait_s:g} s") from None
            with query:
                try:
                    start = consumer.hello(offer)
                except ReenactError as error:
                    self._warn(f"refused an offer: {error}")
                    self._answer(query, Progress(error=str(error)))
                    continue
                with self._lock:
                    self._offer = offer
                    self._progress = Progress(run=offer.run, next=start, received=start)
                    self._last_heard_s = time.monotonic()
                self._answer(query, self._progress)
                return offer

    def _messages(self, *, stride: int) -> Iterator[Stamped]:
        """Yield the stream; a message counts as consumed when the one after its frame is asked for."""
        acknowledged = self._progress.next
        while True:
            frame = self._next_frame()
            if frame.kind is Kind.END:
                return
            if frame.kind is Kind.ABORT:
                raise WireError(f"the sender gave up at message {self._progress.next}: {frame.reason}")
            yield from frame.messages
            self._update(next=frame.end)
            if frame.end - acknowledged >= stride:
                acknowledged = frame.end
                self._ack.put(self._progress.to_json())

    def _next_frame(self) -> Frame:
        while True:
            try:
                return self._frames.get(timeout=1.0)
            except queue.Empty:
                silent_s = time.monotonic() - self._last_heard_s
                if silent_s > self._config.silence_s:
                    raise WireError(
                        f"the sender fell silent {silent_s:.0f} s ago, before message {self._progress.received}: "
                        "it was killed, or the connection is gone"
                    ) from None

    def _report(self, *, result: dict[str, Any] | None = None, error: str | None = None) -> None:
        self._update(result=result, error=error)
        self._ack.put(self._progress.to_json())

    def _update(self, **changes: Any) -> None:
        with self._lock:
            old = self._progress
            self._progress = Progress(
                run=old.run,
                next=changes.get("next", old.next),
                received=changes.get("received", old.received),
                result=changes.get("result", old.result),
                error=changes.get("error", old.error),
            )

    # From here on: Zenoh's threads.

    def _on_sample(self, sample: zenoh.Sample) -> None:
        offer = self._offer
        if offer is None or sample.attachment is None or len(sample.payload) > MAX_PAYLOAD:
            return
        topic = "/" + str(sample.key_expr).removeprefix(self._config.namespace + "/")
        try:
            frame = unpack(topic, sample.payload.to_bytes(), sample.attachment.to_bytes())
        except MessageError:
            return  # not of our stream: anyone may publish here
        if frame.run == offer.run_bytes:
            self._last_heard_s = time.monotonic()
            self._queue_in_order(frame)

    def _queue_in_order(self, frame: Frame) -> None:
        """Queue what is new of a frame; what came before is a repeat, what comes after a gap is sent again."""
        received = self._progress.received
        if frame.kind is Kind.ABORT:
            self._frames.put(frame)
            return
        in_place = frame.first <= received
        new = frame.end > received or (frame.kind is Kind.END and frame.first == received)
        if in_place and new:
            self._update(received=frame.end)
            self._frames.put(frame._replace(first=received, messages=frame.messages[received - frame.first :]))

    def _on_hello(self, query: zenoh.Query) -> None:
        try:
            offer = Offer.from_json(_payload(query))
        except WireError as error:
            with query:
                self._answer(query, Progress(error=str(error)))
            return
        with self._lock:
            taken = self._offer
        if taken is None:
            self._offers.put((offer, query))
            return
        with query:
            if taken.sender == offer.sender:
                self._answer(query, self._progress)
            else:
                self._warn("refused an offer: another replay is feeding this consumer")
                self._answer(query, Progress(error=f"{self._config.name} is already fed by another replay"))

    def _on_status(self, query: zenoh.Query) -> None:
        with query:
            self._last_heard_s = time.monotonic()
            self._answer(query, self._progress)
            if _payload(query) == FAREWELL:
                self._farewell.set()

    def _answer(self, query: zenoh.Query, progress: Progress) -> None:
        query.reply(query.key_expr, progress.to_json())


def _payload(query: zenoh.Query) -> bytes:
    return b"" if query.payload is None or len(query.payload) > MAX_PAYLOAD else query.payload.to_bytes()
