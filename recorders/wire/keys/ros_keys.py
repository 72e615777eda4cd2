"""Topics of a ROS domain as keys of rmw_zenoh, its attachments, and a node of ours in its graph."""

import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from itertools import count
from typing import Any

import zenoh

from recorders.errors import WireError
from recorders.messages.topics import CLOCK, TF, TF_STATIC, type_of
from recorders.protocol.frames import batch_topic
from recorders.rmw_zenoh.attachment import attaching, unpack
from recorders.rmw_zenoh.keys import TopicKey
from recorders.rmw_zenoh.liveliness import EntityType
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import Qos, Reliability, usual_qos
from recorders.rmw_zenoh.type_hashes import UNKNOWN_HASH, type_hash
from recorders.wire.callbacks import on_network_thread
from recorders.wire.history import HistorySubscriber, publishing_latched
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, batch_key, check_namespace
from recorders.wire.keys.other_definitions import reporting_other_definitions
from recorders.wire.keys.ros_node import RosNode
from recorders.wire.keys.topic_keys import EVERY_TOPIC, Attached, KeyedTopic, MessagePublisher, TakeSample
from recorders.wire.session import publishing

_GLOBAL = frozenset((TF, TF_STATIC, CLOCK))  # of a whole system, whatever the namespace of a node


class RosKeys:
    """The topics of a ROS domain; `recorders.wire.keys.topic_keys.TopicKeys` describes the methods.

    Our own topics, but for /tf, /tf_static and /clock, are relative to the node's namespace, as those of ROS 2's own
    nodes are.

    Parameters
    ----------
    domain : int
        The ROS domain.
    node : NodeName
        Name, namespace and remapping of the node.
    namespace : str
        First part of the control keys.
    hashes : mapping of (str, str) to str
        RIHS01 hashes of definitions that are no standard ones, by topic and type.
    humble : bool
        Whether this node publishes without hashes of types, as nodes of ROS 2 Humble do, so that those receive it.
        It receives what is published either way.

    Raises
    ------
    WireError
        If there is no such domain, or the namespace cannot be part of a key.
    """

    def __init__(
        self,
        domain: int,
        node: NodeName,
        *,
        namespace: str = DEFAULT_NAMESPACE,
        hashes: Mapping[tuple[str, str], str] | None = None,
        humble: bool = False,
    ) -> None:
        check_namespace(namespace)
        self.domain = domain
        self.node = RosNode(domain, node)
        self.namespace = namespace
        self.hashes = dict(hashes or {})
        self.humble = humble
        self._named: dict[str, str] = {}  # topics of this node, by their names in the graph

    @property
    def renames(self) -> bool:
        """Whether topics have other names in the graph: by a rule, or by the node's namespace."""
        return bool(self.node.name.rules) or self.node.name.namespace != "/"

    @property
    def everything(self) -> tuple[str, ...]:
        """Key expressions of all messages, and of batches."""
        return self.key(EVERY_TOPIC), batch_key(self.namespace)

    def selection(self, topics: Mapping[str, str]) -> tuple[str, ...]:
        """Return the key expressions of messages on some topics, of one type each, and of batches."""
        keys = (key for topic, kind in topics.items() for key in self.expressions(topic, kind))
        return *keys, batch_key(self.namespace)

    @property
    def words(self) -> str:
        """Where messages are, in words for a line."""
        return f"ROS domain {self.domain}"

    @property
    def alternative(self) -> str:
        """What to choose in order to be elsewhere, in words for a line."""
        return "another domain with --ros"

    def described(self, topic: str, type_name: str = "") -> str:
        """Return a topic with its type, by its name in the graph."""
        if topic == EVERY_TOPIC:
            return f"all topics of {self.words}"
        return f"{self.graph_name(topic)} ({type_name or type_of(topic)}) in {self.words}"

    def expressions(self, topic: str, type_name: str = "") -> tuple[str, ...]:
        """Return the keys of a topic's messages with the hash of their type, and without one."""
        if topic in (EVERY_TOPIC, batch_topic()):
            return (self.key(topic),)
        kind, name = self._type(topic, type_name), self.graph_name(topic)
        hashes = self._definition_hash(topic, kind), UNKNOWN_HASH
        return tuple(TopicKey(self.domain, name, kind, each).to_text() for each in hashes)

    def graph_name(self, topic: str) -> str:
        """Return the name under which a topic is in the graph; raises WireError if it is none."""
        relative = type_of(topic) != "" and topic not in _GLOBAL
        return self.node.name.resolve(topic.removeprefix("/") if relative else topic)

    def key(self, topic: str, type_name: str = "") -> str:
        """Return the key of a topic's messages."""
        if topic == EVERY_TOPIC:
            return f"{self.domain}/**"
        if topic == batch_topic():
            return batch_key(self.namespace)
        kind = self._type(topic, type_name)
        return TopicKey(self.domain, self.graph_name(topic), kind, self._hash(topic, kind)).to_text()

    def read_key(self, key: str) -> KeyedTopic:
        """Return topic, type and hash of a key."""
        if key == batch_key(self.namespace):
            return KeyedTopic(batch_topic(), "", batch_topic())
        found = TopicKey.from_text(key)
        return KeyedTopic(self._own_name(found.topic), found.type, found.topic, found.type_hash)

    def received_as(self, sent_as: str) -> str:
        """Return the name that a rule gives back to a topic of a stream, or the same.

        The stream is for this node, so that one whose name another topic has here is not refused.
        """
        return self._own_name(sent_as) or sent_as

    def read_attachment(self, topic: str, attachment: bytes | None) -> Attached:
        """Return the two parts of an attachment; ours alone on the key of batches."""
        if topic == batch_topic() or attachment is None:
            return Attached(attachment)
        origin, ours = unpack(attachment)
        return Attached(ours or None, origin)

    @contextmanager
    def joined(self, session: zenoh.Session) -> Iterator[None]:
        """Have the node in the graph while the block runs."""
        with self.node.joined(session):
            yield

    def publishing(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None, **options: Any
    ) -> AbstractContextManager[MessagePublisher]:
        """Yield a publisher that is in the graph, and numbers its messages from 1 on; of batches, one that does not."""
        if topic == batch_topic():
            return publishing(session, self.key(topic), **options)
        return self._publishing(session, topic, type_name, qos or usual_qos(topic), options)

    @contextmanager
    def subscribing(
        self, session: zenoh.Session, topic: str, type_name: str, take: TakeSample, *, at_once: bool = False
    ) -> Iterator[None]:
        """Have the samples of a topic of one type taken, cached ones of one that is latched, and be in the graph."""
        keys, qos = self.expressions(topic, type_name), usual_qos(topic)
        history = HistorySubscriber(session, keys if qos.is_latched else [], take)
        deliver = history.deliver if qos.is_latched else take
        with ExitStack() as stack:
            for key in keys:
                declare = partial(session.declare_subscriber, key)
                stack.enter_context(on_network_thread(declare, deliver) if at_once else declare(deliver))
            stack.enter_context(history)
            stack.enter_context(self.announced(session, topic, type_name, qos=qos))  # last: who sees it may publish
            yield

    @contextmanager
    def announced(
        self, session: zenoh.Session, topic: str, type_name: str, *, qos: Qos | None = None
    ) -> Iterator[None]:
        """Be in the graph as a subscription of a topic."""
        name, requested = self._only_name(topic), qos or usual_qos(topic)
        kind = type_name or type_of(topic)
        subscription = EntityType.SUBSCRIPTION
        stated, taken = self._hash(topic, kind), (self._definition_hash(topic, kind), UNKNOWN_HASH)
        with (
            reporting_other_definitions(session, self.domain, name, kind, taken),
            self.node.declared(session, subscription, name, kind, requested, definition_hash=stated),
        ):
            yield

    @contextmanager
    def _publishing(
        self, session: zenoh.Session, topic: str, type_name: str, qos: Qos, options: dict[str, Any]
    ) -> Iterator[MessagePublisher]:
        key, name = self.key(topic, type_name), self._only_name(topic)
        if qos.reliability is Reliability.BEST_EFFORT:
            options = {"reliability": zenoh.Reliability.BEST_EFFORT, **options}
        opened = (
            publishing_latched(session, key, depth=qos.cache_depth, **options)
            if qos.is_latched
            else publishing(session, key, **options)
        )
        kind, publisher = type_name or type_of(topic), EntityType.PUBLISHER
        stated = self._hash(topic, kind)
        with (
            self.node.declared(session, publisher, name, kind, qos, definition_hash=stated) as token,
            opened as inner,
        ):
            yield RosPublisher(inner, token.gid)

    def _only_name(self, topic: str) -> str:
        """Return the name of a topic in the graph; raises WireError if another of this node has it too."""
        name, own = self.graph_name(topic), "/" + topic.removeprefix("/")
        if (other := self._named.setdefault(name, own)) != own:
            raise WireError(f"--remap: expected a name of its own for each topic, found {name} for {other} and {own}")
        return name

    def _own_name(self, graph_name: str) -> str:
        """Return a topic's name as this node has it, `graph_name` the other way; empty where it has none."""
        if not self.renames:
            return graph_name
        name = self.node.name.original(graph_name)
        own = "/" + name.removeprefix(self.node.name.namespace.rstrip("/") + "/")
        own = own if own != name and type_of(own) and own not in _GLOBAL else name
        if own == graph_name and self._is_taken(own):
            return ""
        return own

    def _is_taken(self, topic: str) -> bool:
        """Whether this node gives a name to another topic of the graph."""
        try:
            return self.graph_name(topic) != topic
        except WireError:  # no name that a rule could have
            return False

    def _type(self, topic: str, type_name: str) -> str:
        kind = type_name or type_of(topic)
        if not kind:
            raise WireError(f"{topic}: expected a topic whose type is known, as a key of ROS 2 has it")
        return kind

    def _hash(self, topic: str, type_name: str) -> str:
        """Return what this node states as the hash of a type."""
        return UNKNOWN_HASH if self.humble else self._definition_hash(topic, type_name)

    def _definition_hash(self, topic: str, type_name: str) -> str:
        return self.hashes.get((topic, type_name)) or type_hash(type_name)


class RosPublisher:
    """A publisher that attaches number, time and its own name to what it puts, before what this program attaches.

    Parameters
    ----------
    publisher : MessagePublisher
        Puts the messages.
    gid : bytes
        16 bytes that name the publisher in the graph.
    """

    def __init__(self, publisher: MessagePublisher, gid: bytes) -> None:
        self._put = publisher.put  # each look-up is time that a command takes
        self._publisher = publisher
        self._attach = attaching(gid)
        self._numbers = count(1)

    @property
    def key_expr(self) -> Any:
        """Its key."""
        return self._publisher.key_expr

    @property
    def matching_status(self) -> Any:
        """Whether anybody subscribes, as Zenoh has it."""
        return getattr(self._publisher, "matching_status")  # noqa: B009  # one that is latched has none

    def put(self, payload: bytes, *, encoding: str | None = None, attachment: bytes | None = None) -> None:
        """Publish a message."""
        origin = self._attach(next(self._numbers), time.time_ns())
        self._put(payload, encoding=encoding, attachment=origin + attachment if attachment else origin)
