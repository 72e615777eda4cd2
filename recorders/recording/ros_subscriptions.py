"""Subscriptions of a recorder in a ROS domain: its graph has one for each topic that is recorded."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import TypeAlias

from recorders.errors import MessageError, WireError
from recorders.recording.ros_channels import RosChannels
from recorders.rmw_zenoh.keys import TopicKey
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType
from recorders.rmw_zenoh.qos import Qos, matching
from recorders.text.once import OnceWarner
from recorders.threads import periodic_thread
from recorders.wire.keys.ros_graph import GraphView
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.session import Session
from recorders.writing.writer import MAX_CHANNELS

logger = logging.getLogger(__name__)

_Key: TypeAlias = tuple[str, str, str]  # topic in the graph, type, and hash of its definition

_EVERY_S = 0.1  # how often it is seen whether the graph has changed
_MAX_LINES = 1000  # anyone may publish on as many topics as they like


class RecordedTopics:
    """Declares a subscription of each topic that is published in a ROS domain and recorded, until it is closed.

    Messages come by one subscriber of the whole domain: these are for whoever looks at the graph, or waits there. Each
    requests what matches all publishers of its topic, and is gone once those are.

    Parameters
    ----------
    session : Session
        An open session.
    keys : RosKeys
        The domain.
    view : callable
        The graph as it is now.
    wants : callable
        Whether a topic is recorded.

    Attributes
    ----------
    topics : set of str
        Topics that were published and recorded at any time, as a recording names them.
    """

    def __init__(
        self, session: Session, keys: RosKeys, view: Callable[[], GraphView], wants: Callable[[str], bool]
    ) -> None:
        self._session = session
        self._keys = keys
        self._view = view
        self._wants = wants
        self._seen: GraphView | None = None
        self._declared: dict[_Key, tuple[Qos, ExitStack]] = {}
        self.topics: set[str] = set()
        self._lines = OnceWarner(logger, limit=_MAX_LINES, level=logging.INFO)

    def close(self) -> None:
        """Undeclare all of them."""
        for key in tuple(self._declared):
            self._undeclare(key)

    def update(self) -> None:
        """Declare what is published by now, and undeclare what no longer is."""
        view = self._view()
        if view is self._seen:
            return
        self._seen = view
        wanted = {key: matching(offered) for key, offered in self._published(view).items()}
        for key, (requested, _) in tuple(self._declared.items()):
            if wanted.get(key) != requested:
                self._undeclare(key)
        for key in sorted(wanted.keys() - self._declared.keys()):
            self._declare(key, wanted[key])

    def _published(self, view: GraphView) -> dict[_Key, list[Qos]]:
        """Return what is offered on each topic that is recorded."""
        found: dict[_Key, list[Qos]] = {}
        for token in view.tokens:
            end = token.endpoint
            if token.entity is EntityType.PUBLISHER and end is not None and (topic := self._recorded_topic(end)):
                found.setdefault((end.topic, end.type, end.type_hash), []).append(end.qos)
                if len(self.topics) < MAX_CHANNELS:
                    self.topics.add(topic)
        return found

    def _recorded_topic(self, end: Endpoint) -> str:
        """Return the topic that a publisher's messages are recorded on, empty if on none: anybody declares tokens."""
        try:
            key = TopicKey(self._keys.domain, end.topic, end.type, end.type_hash).to_text()
            topic = self._keys.read_key(key).topic
        except (WireError, MessageError):
            return ""
        return topic if topic and self._wants(topic) else ""

    def _declare(self, key: _Key, requested: Qos) -> None:
        topic, kind, type_hash = key
        with ExitStack() as stack:
            node, subscription = self._keys.node, EntityType.SUBSCRIPTION
            stack.enter_context(
                node.declared(self._session, subscription, topic, kind, requested, definition_hash=type_hash)
            )
            self._declared[key] = requested, stack.pop_all()
        self._lines.warn(f"records {topic} ({kind})")

    def _undeclare(self, key: _Key) -> None:
        self._declared.pop(key)[1].close()


@contextmanager
def recorded_topics(
    session: Session, keys: TopicKeys, channels: RosChannels | None, wants: Callable[[str], bool]
) -> Iterator[set[str]]:
    """Have a recorder's subscriptions in the graph of a ROS domain while the block runs; none in a namespace.

    What it yields is the topics that were published and recorded, as they come.
    """
    if channels is None or not isinstance(keys, RosKeys):
        yield set()
        return
    with closing(RecordedTopics(session, keys, channels.view, wants)) as recorded:
        recorded.update()
        with periodic_thread(recorded.update, name="recorded topics", every_s=_EVERY_S):
            yield recorded.topics
