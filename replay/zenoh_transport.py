"""The sending end over Zenoh: a window of unacknowledged messages, sent again after a gap."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any
from uuid import uuid4

import zenoh

from recorders.errors import ReenactError, WireError
from recorders.records import Stamped
from recorders.stream import Offer, Progress
from recorders.wire.frames import DEFAULT_NAMESPACE, Frame, Kind, batch_key, control_key, message_key, pack
from recorders.wire.receiver import FAREWELL
from replay.transport import StreamFrom

_POLL_S = 1.0  # how long an acknowledgement may be missing before the consumer is asked
_ANSWER_S = 5.0  # how long one answer may take


@dataclass(frozen=True)
class SenderConfig:
    """Whom to feed, and how.

    Parameters
    ----------
    consumers : tuple of str
        Names of the consumers that are awaited; the window is the slowest one's.
    namespace : str
        First part of every key.
    window : int
        How many messages may be under way unacknowledged.
    batch : int
        How many messages travel in one payload; with 1, each travels on the key of its own topic.
    wait_s : float
        How long a consumer may take to appear [s].
    patience_s : float
        How long a consumer may leave every question unanswered [s].
    """

    consumers: tuple[str, ...] = ("learner",)
    namespace: str = DEFAULT_NAMESPACE
    window: int = 1024
    batch: int = 64
    wait_s: float = 10.0
    patience_s: float = 30.0

    def __post_init__(self) -> None:
        """Check ranges."""
        if not self.consumers:
            raise WireError("expected the name of at least one consumer to await, found none")
        if not 1 <= self.batch <= self.window:
            raise WireError(f"expected 1 <= batch <= window, found batch {self.batch} and window {self.window}")


class ZenohTransport:
    """Delivers a stream to consumers in other processes.

    Zenoh alone loses messages without a word when a consumer stalls, so this keeps what is not acknowledged and goes
    back to the first message that did not arrive.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : SenderConfig
        Consumers, window and patience.
    on_progress : callable
        Told how many messages every consumer has consumed.
    """

    def __init__(
        self,
        session: zenoh.Session,
        *,
        config: SenderConfig | None = None,
        on_progress: Callable[[int], None] = lambda consumed: None,
    ) -> None:
        self._session = session
        self._config = config or SenderConfig()
        self._on_progress = on_progress

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream; see `Transport.deliver`."""
        offer = replace(offer, sender=uuid4().hex, window=self._config.window)
        with _Delivery(self._session, self._config, offer, self._on_progress) as delivery:
            return delivery.run(stream_from)


class _Delivery:
    """One stream under way: what was sent, what was acknowledged."""

    def __init__(
        self, session: zenoh.Session, config: SenderConfig, offer: Offer, on_progress: Callable[[int], None]
    ) -> None:
        self._session = session
        self._config = config
        self._offer = offer
        self._on_progress = on_progress
        self._changed = threading.Condition()
        self._progress: dict[str, Progress] = {}
        self._unacknowledged: deque[Frame] = deque()
        self._sent = 0
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._stack = ExitStack()

    def __enter__(self) -> "_Delivery":
        for name in self._config.consumers:
            key = control_key(self._config.namespace, name, "ack")
            self._stack.enter_context(self._session.declare_subscriber(key, self._on_ack(name)))
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def run(self, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        self._progress = {name: self._hello(name) for name in self._config.consumers}
        self._sent = start = min(progress.next for progress in self._progress.values())
        try:
            for messages in _chunks(stream_from(start), self._config.batch):
                limit = self._config.window - len(messages)
                self._await(lambda limit=limit: self._sent - self._consumed() <= limit)  # type: ignore[misc]
                kind = Kind.BATCH if self._config.batch > 1 else Kind.MESSAGE
                self._send(Frame(kind, self._offer.run_bytes, self._sent, tuple(messages)))
        except BaseException as error:
            reason = str(error) if isinstance(error, ReenactError) else f"stopped by {type(error).__name__}"
            self._put(Frame(Kind.ABORT, self._offer.run_bytes, self._sent, reason=reason))
            raise
        self._send(Frame(Kind.END, self._offer.run_bytes, self._sent))
        self._await(lambda: all(progress.result is not None for progress in self._progress.values()))
        results = {name: progress.result or {} for name, progress in self._progress.items()}
        for name in self._config.consumers:
            self._ask(name, "status", FAREWELL)
        return results

    def _hello(self, name: str) -> Progress:
        """Offer the stream until the consumer answers."""
        deadline = time.monotonic() + self._config.wait_s
        while True:
            answer = self._ask(name, "hello", self._offer.to_json(), timeout_s=max(self._config.wait_s, _ANSWER_S))
            if answer is not None:
                return _checked(name, answer)
            if time.monotonic() > deadline:
                raise WireError(
                    f"no consumer named {name!r} answered within {self._config.wait_s:g} s; "
                    "start one with `reenact learn`, or give its endpoint with --connect"
                )
            time.sleep(0.05)

    def _ask(self, name: str, verb: str, payload: bytes, *, timeout_s: float = _ANSWER_S) -> Progress | None:
        """Query a consumer; None if it does not answer."""
        key = control_key(self._config.namespace, name, verb)
        for reply in self._session.get(key, payload=payload, timeout=timeout_s):
            if reply.ok is not None:
                return Progress.from_json(reply.ok.payload.to_bytes())
        return None

    def _send(self, frame: Frame) -> None:
        self._unacknowledged.append(frame)
        self._sent = frame.end
        self._put(frame)

    def _put(self, frame: Frame) -> None:
        single = frame.kind is Kind.MESSAGE
        namespace = self._config.namespace
        key = message_key(namespace, frame.messages[0].topic) if single else batch_key(namespace)
        payload, attachment = pack(frame)
        self._publisher(key).put(payload, attachment=attachment)

    def _publisher(self, key: str) -> zenoh.Publisher:
        if key not in self._publishers:
            # The default, DROP, loses a third of a burst.
            publisher = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
            self._publishers[key] = self._stack.enter_context(publisher)
        return self._publishers[key]

    def _consumed(self) -> int:
        return min(progress.next for progress in self._progress.values())

    def _await(self, done: Callable[[], bool]) -> None:
        """Wait until the consumers' progress satisfies `done`; ask them when they are quiet."""
        last_answer_s = time.monotonic()
        stuck: dict[str, int] = {}
        while True:
            with self._changed:
                advanced = self._changed.wait_for(lambda: done() or self._failed(), timeout=_POLL_S)
            self._discard_acknowledged()
            self._raise_failure()
            if advanced:
                return
            if self._poll(stuck):
                last_answer_s = time.monotonic()
            elif time.monotonic() - last_answer_s > self._config.patience_s:
                raise WireError(
                    f"{', '.join(self._config.consumers)}: no answer for {self._config.patience_s:g} s "
                    f"after message {self._consumed()}; the rest of {self._sent} sent is unconfirmed"
                )

    def _poll(self, stuck: dict[str, int]) -> bool:
        """Ask every consumer how far it is, and send again what one has twice said it lacks. False if one is silent."""
        for name in self._config.consumers:
            answer = self._ask(name, "status", b"")
            if answer is None:
                return False
            if answer.run != self._offer.run:
                raise WireError(f"{name}: was started anew and no longer knows this run; replay again")
            self._note(name, answer)
            lost = answer.received < self._sent or (answer.result is None and self._ended())
            if lost and stuck.get(name) == answer.received:
                self._resend(answer.received)
            stuck[name] = answer.received
        return True

    def _ended(self) -> bool:
        return bool(self._unacknowledged) and self._unacknowledged[-1].kind is Kind.END

    def _resend(self, index: int) -> None:
        for frame in tuple(self._unacknowledged):
            if frame.end > index or frame.kind is Kind.END:
                self._put(frame)

    def _discard_acknowledged(self) -> None:
        consumed = self._consumed()
        while self._unacknowledged and self._unacknowledged[0].end <= consumed:
            if self._unacknowledged[0].kind is Kind.END:
                break
            self._unacknowledged.popleft()
        self._on_progress(consumed)

    def _failed(self) -> bool:
        return any(progress.error is not None for progress in self._progress.values())

    def _raise_failure(self) -> None:
        for name, progress in self._progress.items():
            _checked(name, progress)

    def _on_ack(self, name: str) -> Callable[[zenoh.Sample], None]:
        def note(sample: zenoh.Sample) -> None:
            try:
                progress = Progress.from_json(sample.payload.to_bytes())
            except WireError:
                return  # not from our consumer: anyone may publish here
            self._note(name, progress)

        return note

    def _note(self, name: str, progress: Progress) -> None:
        """Take a consumer's word, if it is of this run and not older than what is known."""
        if progress.run != self._offer.run:
            return
        with self._changed:
            known = self._progress.get(name)
            if known is None or progress.next >= known.next:
                self._progress[name] = progress
                self._changed.notify_all()


def _checked(name: str, progress: Progress) -> Progress:
    if progress.error is not None:
        raise WireError(f"{name}: {progress.error}")
    return progress


def _chunks(messages: Iterator[Stamped], size: int) -> Iterator[Sequence[Stamped]]:
    while chunk := list(islice(messages, size)):
        yield chunk
