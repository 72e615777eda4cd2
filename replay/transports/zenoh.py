"""The sending end over Zenoh: a window of unacknowledged messages, sent again after a gap."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any
from uuid import uuid4

import zenoh

from recorders.errors import ReenactError, WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.wire.channel_table import published_channels
from recorders.wire.frames import (
    MAX_PAYLOAD,
    Frame,
    FrameType,
    batch_key,
    control_key,
    message_key,
    pack,
)
from recorders.wire.session import has_subscribers, publishing
from recorders.wire.stream import Offer, Progress, asking
from replay.transports.awaited_controllers import AwaitedControllers, await_matching, controller_status
from replay.transports.batches import batches
from replay.transports.patience import Patience
from replay.transports.send_window import Rewind, SendWindow, checked
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import StreamFrom

logger = logging.getLogger(__name__)

_VERBS = {"learner": "learn", "recorder": "record", "controller": "serve"}  # by the name that each has by default
_ACK_TIMEOUT_S = 1.0  # how long an acknowledgement may be missing before the consumer is asked
_ANSWER_S = 5.0  # how long one answer may take
_LISTENER_WAIT_S = 2.0  # a listener that is connected is known within milliseconds; one may just be starting
_ALIVE_S = 1.0  # how often a sender that has nothing to send shows the consumers that it still lives


class ZenohTransport:
    """Delivers a stream to consumers in other processes.

    Zenoh alone loses messages without a word when a consumer stalls, so this keeps what is not acknowledged and goes
    back to the first message that did not arrive. A consumer that was killed and started anew states where it wants to
    go on, and the stream is taken up there.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    config : SenderConfig
        Consumers, window and patience.
    on_progress : callable
        Called with how many messages every consumer has consumed.
    channels : sequence of DeclaredChannel
        The channels of what is sent, published for recorders: by the names that it is sent under.
    """

    def __init__(
        self,
        session: zenoh.Session,
        *,
        config: SenderConfig | None = None,
        on_progress: Callable[[int], None] = lambda consumed: None,
        channels: Sequence[DeclaredChannel] = (),
    ) -> None:
        self._session = session
        self._config = config or SenderConfig()
        self._on_progress = on_progress
        self._channels = channels

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream; see `Transport.deliver`."""
        if not self._config.consumers and not self._find_listener():
            logger.warning(
                f"nobody listens in namespace '{self._config.namespace}' yet; the stream begins all the same"
            )
        offer = replace(offer, sender=uuid4().hex, window=self._config.window)
        with (
            published_channels(self._session, self._config.namespace, offer.sender, self._channels),
            _Delivery(self._session, self._config, offer, self._on_progress, self._channels) as delivery,
        ):
            return delivery.run(stream_from)

    def _find_listener(self) -> bool:
        """Wait a little for anyone who listens: what is put before Zenoh knows of a subscriber never reaches it."""
        deadline = time.monotonic() + _LISTENER_WAIT_S
        everything = f"{self._config.namespace}/**"
        with self._session.declare_publisher(everything, allowed_destination=zenoh.Locality.REMOTE) as probe:
            while not has_subscribers(probe):
                if time.monotonic() > deadline:
                    return False
                time.sleep(0.01)
        return True


class _Delivery:
    """One stream under way: `SendWindow` decides, step by step; this sends, asks and waits."""

    def __init__(
        self,
        session: zenoh.Session,
        config: SenderConfig,
        offer: Offer,
        on_progress: Callable[[int], None],
        channels: Sequence[DeclaredChannel],
    ) -> None:
        self._session = session
        self._config = config
        self._offer = offer
        self._on_progress = on_progress
        self._no_cdr = {(channel.topic, channel.type) for channel in channels if channel.encoding != "cdr"}
        self._changed = threading.Condition()
        self._window = SendWindow(offer.run, config.window)
        self._controllers = AwaitedControllers(session, config.namespace)
        self._ended = False
        self._leaving = threading.Event()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._stack = ExitStack()

    def __enter__(self) -> "_Delivery":
        self._stack.enter_context(self._controllers)
        for name in self._config.consumers:
            key = control_key(self._config.namespace, name, "ack")
            self._stack.enter_context(self._session.declare_subscriber(key, self._on_ack(name)))
        heartbeat = threading.Thread(target=self._stay_alive, daemon=True)
        heartbeat.start()
        self._stack.callback(heartbeat.join)
        self._stack.callback(self._leaving.set)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def run(self, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream and return the consumers' results by name."""
        try:
            for name in self._config.consumers:
                self._greet(name)
            index = self._window.start()
            while not self._ended:
                try:
                    self._send_from(index, stream_from)
                except Rewind as rewind:
                    index = rewind.index
        except BaseException as error:
            self._abort(_why(error))
            raise
        results = {name: progress.result or {} for name, progress in self._window.progress.items()}
        for name in results:
            self._ask(name, "status", asking(self._offer, farewell=True))
        return results | self._controllers.results()

    def _send_from(self, index: int, stream_from: StreamFrom) -> None:
        """Send the stream from an index to its end, and wait for the results."""
        self._window.begin(index)
        batched = self._config.batch_size > 1
        for messages in batches(stream_from(index), self._config.batch_size):
            self._await_room(len(messages), sum(len(message.data) for message in messages))
            self._send(self._frame(FrameType.BATCH if batched else FrameType.MESSAGE, tuple(messages)))
        self._send(self._frame(FrameType.END))
        self._await(lambda: self._window.through)
        self._ended = True

    def _frame(self, kind: FrameType, messages: tuple[RecordedMessage, ...] = (), reason: str = "") -> Frame:
        return Frame(kind, *self._offer.identity, self._window.sent, messages, reason)

    def _abort(self, reason: str) -> None:
        """Inform the consumers that may have taken the offer, as well as the connection allows."""
        with suppress(zenoh.ZError):
            self._put(self._frame(FrameType.ABORT, reason=reason))

    def _greet(self, name: str) -> None:
        """Wait until a consumer answers, or a served controller of that name is ready."""
        answer = self._hello(name)
        if isinstance(answer, Progress):
            self._window.progress[name] = answer
            self._check_start(name, answer.next)
            return
        if self._config.batch_size > 1:
            raise WireError(
                f"{name} is a controller, which takes messages one by one as they come: pace the replay with --rate, "
                f"found batches of {self._config.batch_size}"
            )
        await_matching(
            self._publisher, answer, namespace=self._config.namespace, wait_s=max(self._config.wait_s, _ANSWER_S)
        )
        self._controllers.add(name)

    def _hello(self, name: str) -> Progress | dict[str, Any]:
        """Offer the stream until the consumer answers, or return the status of the controller that does."""
        deadline = time.monotonic() + self._config.wait_s
        while True:
            answer = self._ask(name, "hello", self._offer.to_json(), timeout_s=max(self._config.wait_s, _ANSWER_S))
            if answer is not None:
                return checked(name, answer)
            status = controller_status(self._session, name, namespace=self._config.namespace)
            if status is not None:
                return status
            if time.monotonic() > deadline:
                raise WireError(
                    f"no consumer named {name!r} answered within {self._config.wait_s:g} s; "
                    f"start one with {_starting(name)}, or give its endpoint with --connect"
                )
            time.sleep(0.05)

    def _check_start(self, name: str, start: int) -> None:
        if self._offer.messages is not None and start > self._offer.messages:
            raise WireError(f"{name}: wants message {start} of a stream that has {self._offer.messages}")

    def _ask(self, name: str, verb: str, payload: bytes, *, timeout_s: float = _ANSWER_S) -> Progress | None:
        """Query a consumer; None if it does not answer."""
        key = control_key(self._config.namespace, name, verb)
        for reply in self._session.get(key, payload=payload, timeout=timeout_s):
            if reply.ok is not None:
                return Progress.from_json(reply.ok.payload.to_bytes())
        return None

    def _send(self, frame: Frame) -> None:
        self._window.add(frame)
        self._put(frame)

    def _put(self, frame: Frame) -> None:
        single = frame.kind is FrameType.MESSAGE
        namespace = self._config.namespace
        key = message_key(namespace, frame.messages[0].topic) if single else batch_key(namespace)
        payload, attachment = pack(frame)
        if len(payload) > MAX_PAYLOAD:
            topic = frame.messages[0].topic
            raise WireError(f"{topic}: expected at most {MAX_PAYLOAD} bytes in a message, found {len(payload)}")
        encoding = self._encoding(frame.messages[0]) if single else None
        self._publisher(key).put(payload, attachment=attachment, encoding=encoding)

    def _encoding(self, message: RecordedMessage) -> str:
        """Return the encoding of a message, and its type, for subscribers that receive it alone."""
        kind = "octet-stream" if (message.topic, message.type) in self._no_cdr else "cdr"
        return f"application/{kind};{message.type}"

    def _publisher(self, key: str) -> zenoh.Publisher:
        if key not in self._publishers:
            # The default, DROP, loses a third of a burst.
            publisher = publishing(self._session, key, congestion_control=zenoh.CongestionControl.BLOCK)
            self._publishers[key] = self._stack.enter_context(publisher)
        return self._publishers[key]

    def _await_room(self, count: int, size: int) -> None:
        """Wait until the window has room for more messages, of so many bytes together."""
        self._controllers.check()
        self._await(lambda: self._window.has_room(count, size))

    def _await(self, done: Callable[[], bool]) -> None:
        """Wait until the consumers' progress satisfies `done`; ask them when they are quiet."""
        watch = Patience(self._config.patience_s)
        while True:
            with self._changed:
                advanced = self._changed.wait_for(lambda: self._window.failed or done(), timeout=_ACK_TIMEOUT_S)
            self._window.check()
            self._on_progress(self._window.discard_consumed())
            if advanced:
                return
            for name in tuple(self._window.progress):
                if self._window.progress[name].result is None:
                    self._poll(name, watch)

    def _poll(self, name: str, watch: Patience) -> None:
        """Ask a consumer how far it is, and send again what it has reported missing twice."""
        answer = self._ask(name, "status", asking(self._offer))
        if answer is not None and answer.run != self._offer.run:
            self._greet(name)  # it was started anew
            raise Rewind(self._window.progress[name].next)
        if answer is not None:
            self._note(name, answer)
        lacking = answer is None or self._window.lacks(answer)
        if watch.lacks(name, None if answer is None else answer.received, lacking=lacking) and answer is not None:
            for frame in self._window.missing(name, answer):
                self._put(frame)

    def _on_ack(self, name: str) -> Callable[[zenoh.Sample], None]:
        def note(sample: zenoh.Sample) -> None:
            with suppress(WireError, zenoh.ZError):  # anyone may publish here, also what is no progress at all
                progress = Progress.from_json(sample.payload.to_bytes())
                if progress.run == self._offer.run and progress.is_final:
                    confirmed = self._ask(name, "status", asking(self._offer))
                    progress = confirmed or replace(progress, result=None, error=None)
                if self._window.can_be(progress):
                    self._note(name, progress)

        return note

    def _stay_alive(self) -> None:
        """Let the consumers that have taken the offer know that the sender lives, while the stream has a pause."""
        while not self._leaving.wait(_ALIVE_S):
            for name in tuple(self._window.progress):
                with suppress(WireError, zenoh.ZError):
                    self._ask(name, "status", asking(self._offer), timeout_s=1.0)

    def _note(self, name: str, progress: Progress) -> None:
        with self._changed:
            if self._window.note(name, progress):
                self._changed.notify_all()


def _starting(name: str) -> str:
    """Return the command that starts a consumer of that name."""
    if name in _VERBS:
        return f"`reenact {_VERBS[name]}`"
    return f"`reenact learn --name {name}`, `reenact record --name {name}` or `reenact serve --name {name}`"


def _why(error: BaseException) -> str:
    """Return in words why a stream is given up: its readers know nothing of this program's insides."""
    if isinstance(error, ReenactError):
        return str(error)
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return "terminated" if isinstance(error, SystemExit) else "it failed, and reports why itself"
