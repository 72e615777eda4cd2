"""The mapping between topics and Zenoh: keys, attachments, and whoever is seen by them. That of a namespace is here."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias

import zenoh

from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.qos import Qos
from recorders.wire.callbacks import on_network_thread
from recorders.wire.history import publishing_latched
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, check_namespace, message_key
from recorders.wire.session import publishing

EVERY_TOPIC = "**"
"""In place of a topic: all of them."""

TakeSample: TypeAlias = Callable[[zenoh.Sample], None]
"""Takes a sample."""


class KeyedTopic(NamedTuple):
    """What a key states.

    Attributes
    ----------
    topic : str
        Topic, as this node names it; empty where remapping has given the name to another.
    type : str
        ROS 2 type of its messages; empty if the key states none.
    sent_as : str
        Topic, as whoever published there names it.
    type_hash : str
        RIHS01 hash of that type's definition; empty if the key states none.
    """

    topic: str
    type: str
    sent_as: str
    type_hash: str = ""


class Attached(NamedTuple):
    """What is attached to a message.

    Attributes
    ----------
    ours : bytes or None
        The part that this program attaches; None if there is none.
    origin : Attachment or None
        Number, time and publisher, as rmw_zenoh attaches them; None where that is not the mapping.
    """

    ours: bytes | None
    origin: Attachment | None = None


class MessagePublisher(Protocol):
    """A publisher of one topic; `zenoh.Publisher` is one."""

    @property
    def key_expr(self) -> Any:
        """Its key."""

    def put(self, payload: bytes, *, encoding: str | None = None, attachment: bytes | None = None) -> None:
        """Publish a message with what this program attaches to it."""


class TopicKeys(Protocol):
    """One mapping between topics and keys, chosen when a program starts; all else is the same above it.

    Control keys, batches and tables are in a namespace of ours under every mapping.
    """

    @property
    def namespace(self) -> str:
        """First part of the control keys."""

    @property
    def renames(self) -> bool:
        """Whether topics of this node have other names for others."""

    @property
    def everything(self) -> tuple[str, ...]:
        """Key expressions of all messages, those of batches among them."""

    def selection(self, topics: Mapping[str, str]) -> tuple[str, ...]:
        """Return the key expressions of messages on some topics, and of batches; more may match where that is cheap.

        Parameters
        ----------
        topics : mapping of str to str
            Types by topic.
        """

    @property
    def words(self) -> str:
        """Where messages are, in words for a line."""

    @property
    def alternative(self) -> str:
        """What to choose in order to be elsewhere, in words for a line."""

    def described(self, topic: str, type_name: str = "") -> str:
        """Return a topic, or all of them, in words for a line."""

    def expressions(self, topic: str, type_name: str = "") -> tuple[str, ...]:
        """Return the key expressions of what anybody publishes on a topic, of a type as `key` has it."""

    def key(self, topic: str, type_name: str = "") -> str:
        """Return the key of what this node publishes on a topic, of a type; that in our table if it is left out.

        Raises
        ------
        WireError, MessageError
            If topic or type cannot be part of a key.
        """

    def read_key(self, key: str) -> KeyedTopic:
        """Return what a key states that matches `everything`; raises MessageError if it is of no topic."""

    def received_as(self, sent_as: str) -> str:
        """Return the name that this node has for a topic of a stream, which states topics as its sender names them."""

    def read_attachment(self, topic: str, attachment: bytes | None) -> Attached:
        """Return what is attached to a message; raises MessageError if that cannot be of this mapping."""

    def joined(self, session: zenoh.Session) -> AbstractContextManager[None]:
        """Be seen as a node while the block runs; to be entered as soon as a session is open."""

    def publishing(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None, **options: Any
    ) -> AbstractContextManager[MessagePublisher]:
        """Yield a publisher; the `options` are Zenoh's, and `qos` is the topic's own if it is left out."""

    def subscribing(
        self, session: zenoh.Session, topic: str, type_name: str, take: TakeSample, *, at_once: bool = False
    ) -> AbstractContextManager[None]:
        """Have the samples of a topic taken while the block runs; `at_once` on the thread that reads the network."""

    def announced(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None
    ) -> AbstractContextManager[None]:
        """Be seen to subscribe to a topic while the block runs, for whoever subscribes to more at once."""


@dataclass(frozen=True)
class NamespaceKeys:
    """Topics below a namespace: `NAMESPACE/hand/left/target`; nobody is seen by them.

    Parameters
    ----------
    namespace : str
        First part of every key.

    Raises
    ------
    WireError
        If it cannot be that.
    """

    namespace: str = DEFAULT_NAMESPACE

    def __post_init__(self) -> None:
        check_namespace(self.namespace)

    @property
    def renames(self) -> bool:
        """Whether topics have other names for others: never."""
        return False

    @property
    def everything(self) -> tuple[str, ...]:
        """Key expressions of all messages."""
        return (self.key(EVERY_TOPIC),)

    def selection(self, topics: Mapping[str, str]) -> tuple[str, ...]:
        """Return the key expression of all messages: in a namespace nobody publishes what is of no use there."""
        return self.everything

    @property
    def words(self) -> str:
        """Where messages are, in words for a line."""
        return f"namespace '{self.namespace}'"

    @property
    def alternative(self) -> str:
        """What to choose in order to be elsewhere, in words for a line."""
        return "a --namespace"

    def described(self, topic: str, type_name: str = "") -> str:
        """Return the key of a topic."""
        return self.key(topic)

    def expressions(self, topic: str, type_name: str = "") -> tuple[str, ...]:
        """Return the key of a topic."""
        return (self.key(topic),)

    def key(self, topic: str, type_name: str = "") -> str:
        """Return the key of a topic, whatever the type."""
        return f"{self.namespace}/**" if topic == EVERY_TOPIC else message_key(self.namespace, topic)

    def read_key(self, key: str) -> KeyedTopic:
        """Return the topic of a key."""
        topic = "/" + key.removeprefix(self.namespace + "/")
        return KeyedTopic(topic, "", topic)

    def received_as(self, sent_as: str) -> str:
        """Return the same name."""
        return sent_as

    def read_attachment(self, topic: str, attachment: bytes | None) -> Attached:
        """Return the attachment, which is ours or somebody's own."""
        return Attached(attachment)

    @contextmanager
    def joined(self, session: zenoh.Session) -> Iterator[None]:
        """Do nothing: nodes of a namespace are seen by `recorders.nodes`."""
        yield

    def publishing(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None, **options: Any
    ) -> AbstractContextManager[MessagePublisher]:
        """Yield a publisher of a topic."""
        if qos is not None and qos.is_latched:
            return publishing_latched(session, self.key(topic), depth=qos.cache_depth, **options)
        return publishing(session, self.key(topic), **options)

    @contextmanager
    def subscribing(
        self, session: zenoh.Session, topic: str, type_name: str, take: TakeSample, *, at_once: bool = False
    ) -> Iterator[None]:
        """Have the samples of a topic taken, whatever their type."""
        declare = partial(session.declare_subscriber, self.key(topic))
        with on_network_thread(declare, take) if at_once else declare(take):
            yield

    @contextmanager
    def announced(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None
    ) -> Iterator[None]:
        """Do nothing: nobody looks at who subscribes."""
        yield
