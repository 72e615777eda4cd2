"""Delivers a stream over Zenoh to consumers in other processes, and to served controllers."""

import logging
import secrets
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from recorders.errors import ReenactError, WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.protocol.seals.authentication import KEY_BYTES
from recorders.protocol.seals.opening import UnansweredError
from recorders.protocol.sender import SenderMachine
from recorders.protocol.stream import Offer
from recorders.rmw_zenoh.qos import usual_qos
from recorders.wire.channel_table import published_channels
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.refusals import Refusals
from recorders.wire.sender import StreamSender, find_listener
from recorders.wire.session import Session
from recorders.wire.shared_key import shared_key
from replay.transports.awaited_controllers import AwaitedControllers, ask_controller, await_matching
from replay.transports.awaited_subscriptions import await_subscriptions
from replay.transports.batches import batches
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import StreamFrom

logger = logging.getLogger(__name__)

_VERBS = {"learner": "learn", "recorder": "record", "controller": "serve"}  # by the name that each has by default
_ELSEWHERE = "give its endpoint with --connect"
_SUBSCRIBED_S = 5.0  # how long it may take until what is put reaches a controller that answers


class ZenohTransport:
    """Delivers a stream to consumers in other processes.

    Zenoh alone loses messages without a word when a consumer stalls, so this keeps what is not acknowledged and goes
    back to the first message that did not arrive. A consumer that was killed and started anew states where it wants to
    go on, and the stream is taken up there.

    Parameters
    ----------
    session : Session
        An open session.
    config : SenderConfig
        Consumers, window and patience.
    on_progress : callable
        Called with how many messages every consumer has consumed.
    channels : sequence of DeclaredChannel
        The channels of what is sent, published for recorders: by the names that it is sent under.

    Attributes
    ----------
    refused : counter of str
        How many answers and acknowledgements were refused, by key and reason.
    """

    def __init__(
        self,
        session: Session,
        *,
        config: SenderConfig | None = None,
        on_progress: Callable[[int], None] = lambda consumed: None,
        channels: Sequence[DeclaredChannel] = (),
    ) -> None:
        self._session = session
        self._config = config or SenderConfig()
        self._on_progress = on_progress
        self._channels = channels
        self._refusals = Refusals()

    @property
    def refused(self) -> Counter[str]:
        """How many answers and acknowledgements were refused, by key and reason."""
        return self._refusals.counts

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        """Deliver the stream; see `Transport.deliver`."""
        namespace = self._config.namespace
        awaited = self._config.consumers or self._config.wait_for
        if not awaited and not find_listener(self._session, self._config.keys):
            logger.warning(f"nobody listens in {self._config.keys.words} yet; the stream begins all the same")
        offer = replace(offer, sender=secrets.token_hex(16), window=self._config.window)
        with (
            published_channels(self._session, namespace, offer.sender, self._channels),
            AwaitedControllers(self._session, namespace) as controllers,
            self._sender(offer).running() as sender,
        ):
            try:
                self._join_domain(sender)
                results = sender.deliver(
                    lambda start: map(tuple, batches(stream_from(start), self._config.batch_size)),
                    before_each=controllers.check,
                    on_progress=self._on_progress,
                    is_exempt=lambda name: self._is_controller(name, controllers, sender),
                )
            except UnansweredError as error:
                sender.abort(str(error))
                raise WireError(f"{error}; start one with {_starting(error.consumer)}, or {_ELSEWHERE}") from error
            except BaseException as error:
                sender.abort(_why(error))
                raise
            return results | controllers.results()

    def _join_domain(self, sender: StreamSender) -> None:
        """Have all topics in the graph of a ROS domain before the first message, and wait for who is awaited there."""
        keys, config = self._config.keys, self._config
        if isinstance(keys, RosKeys):
            publishers = {
                channel.topic: (channel.type, sender.publisher(channel.topic, channel.type))
                for channel in self._channels
            }
            await_subscriptions(
                self._session,
                keys,
                config.wait_for,
                publishers,
                is_latched=lambda topic: (config.qos.get(topic) or usual_qos(topic)).is_latched,
                wait_s=config.wait_s,
            )

    def _sender(self, offer: Offer) -> StreamSender:
        config = self._config
        machine = SenderMachine(
            offer,
            config.consumers,
            key=shared_key(config.key_file) if config.consumers else secrets.token_bytes(KEY_BYTES),
            refuse=lambda key, reason: self._refusals.count(f"@consumer/{key}", reason),
            batched=config.batch_size > 1,
            wait_s=config.wait_s,
            patience_s=config.patience_s,
        )
        no_cdr = {(channel.topic, channel.type) for channel in self._channels if channel.encoding != "cdr"}

        def encoding(message: RecordedMessage) -> str:
            """Return the encoding of a message, and its type, for subscribers that receive it alone."""
            kind = "octet-stream" if (message.topic, message.type) in no_cdr else "cdr"
            return f"application/{kind};{message.type}"

        return StreamSender(self._session, config.keys, machine, config.consumers, encoding=encoding, qos=config.qos)

    def _is_controller(self, name: str, controllers: AwaitedControllers, sender: StreamSender) -> bool:
        """Whether a served controller of that name is there, which from now on is awaited."""
        answer = ask_controller(self._session, name, namespace=self._config.namespace)
        if answer is None:
            return False
        if self._config.batch_size > 1:
            raise WireError(
                f"{name} is a controller, which takes messages one by one as they come: pace the replay with --rate, "
                f"found batches of {self._config.batch_size}"
            )
        wait_s = max(self._config.wait_s, _SUBSCRIBED_S)
        types = {channel.topic: channel.type for channel in self._channels} or None
        await_matching(sender.publisher, answer.status, types=types, wait_s=wait_s)
        controllers.add(name, answer)
        return True


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
