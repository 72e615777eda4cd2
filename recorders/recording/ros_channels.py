"""Channels of what is recorded in a ROS domain: type, hash and quality of service, as the graph states them."""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from recorders.errors import WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.rmw_zenoh.bag_channels import bag_channel
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType, Token
from recorders.rmw_zenoh.qos import Qos
from recorders.text.once import OnceWarner
from recorders.text.wording import escape_control
from recorders.wire.keys.ros_graph import GraphView, RosGraph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.session import Session
from recorders.writing.writer import MAX_CHANNELS

logger = logging.getLogger(__name__)

TOO_MANY_TOKENS = "tokens of the graph: too many"
"""Reason by which a recording counts those as refused."""

_Key: TypeAlias = tuple[str, str, str]  # topic, type, and hash of its definition

_MAX_LINES = 100  # anyone may publish on as many topics as they like


class RosChannels:
    """The channel of each topic: as its publishers were when the first message came, and the same in every file.

    Parameters
    ----------
    view : callable
        The graph as it is now.
    graph_name : callable
        The name in the graph of a topic that is recorded; raises WireError if it can have none there.
    too_many : callable
        How many tokens are not in the view, as they were too many.
    departed : callable
        Tokens that are there no more: what their publishers sent may be taken later.
    """

    def __init__(
        self,
        view: Callable[[], GraphView],
        graph_name: Callable[[str], str],
        too_many: Callable[[], int] = int,
        departed: Callable[[], Iterable[Token]] = tuple,
    ) -> None:
        self.view = view
        self.too_many = too_many
        self._departed = departed
        self._graph_name = graph_name
        self._channels: dict[_Key, DeclaredChannel] = {}
        self._offered: dict[_Key, frozenset[Qos]] = {}
        self._warnings = OnceWarner(logger, limit=_MAX_LINES)

    def channel(self, record: RecordedMessage, type_hash: str = "") -> DeclaredChannel:
        """Return the channel of a message.

        Parameters
        ----------
        record : RecordedMessage
            The message.
        type_hash : str
            RIHS01 hash of its type's definition, as its key states it; that of the first publisher if it is left out.
        """
        key = record.topic, record.type, type_hash
        found = self._channels.get(key)
        if found is None:
            found = self._declared(*key)
            if len(self._channels) < MAX_CHANNELS:
                self._channels[key] = found
        return found

    def node_of(self, record: RecordedMessage, gid: bytes, type_hash: str = "", *, session: str = "") -> str:
        """Return the name of the node that published a message, the first of its publisher; empty if none is known.

        It is reported if by now another quality of service is offered on the topic than its channel states.

        Parameters
        ----------
        record : RecordedMessage
            The message.
        gid : bytes
            The publisher, as it names itself: in rmw_zenoh by the hash of its token, which clients of others may not.
        type_hash : str
            RIHS01 hash of its type's definition.
        session : str
            The session that stamped the message, whose only node with such a publisher is it otherwise.
        """
        key = record.topic, record.type, type_hash
        publishers, stated = self._publishers(*key), self._offered.get(key)
        others = [token for token, end in publishers if stated is not None and end.qos not in stated]
        if others:
            self._warnings.warn(
                f"{escape_control(record.topic)}: {escape_control(others[0].node.full_name)} came later and offers "
                "another quality of service; the recording states that of the publishers which were there first"
            )
        tokens = [token for token, _ in publishers] + [token for token, _ in self._of(self._departed(), *key)]
        by_gid = {token.node.full_name for token in tokens if token.gid == gid}
        found = by_gid or {token.node.full_name for token in tokens if token.session == session}
        return found.pop() if len(found) == 1 else ""

    def _declared(self, topic: str, kind: str, type_hash: str) -> DeclaredChannel:
        key = topic, kind, type_hash
        publishers = [end for _, end in self._publishers(*key) or self._of(self._departed(), *key)]
        profiles = [end.qos for end in publishers]
        if len(self._offered) < MAX_CHANNELS:
            self._offered[topic, kind, type_hash] = frozenset(profiles)
        hashes = dict.fromkeys(end.type_hash for end in publishers)
        if len(hashes) > 1:
            self._warnings.warn(
                f"{escape_control(topic)}: its publishers have different definitions of {kind}: their messages are "
                "recorded as those of the first"
            )
        return bag_channel(topic, kind, type_hash or next(iter(hashes), ""), profiles)

    def _publishers(self, topic: str, kind: str, type_hash: str) -> list[tuple[Token, Endpoint]]:
        return self._of(self.view().tokens, topic, kind, type_hash)

    def _of(self, tokens: Iterable[Token], topic: str, kind: str, type_hash: str) -> list[tuple[Token, Endpoint]]:
        """Return those tokens which are of publishers of a topic, with their side of it."""
        try:
            name = self._graph_name(topic)
        except WireError:
            return []
        ends = [(token, token.endpoint) for token in tokens if token.entity is EntityType.PUBLISHER]
        return [
            (token, end)
            for token, end in ends
            if end is not None and (end.topic, end.type) == (name, kind) and type_hash in ("", end.type_hash)
        ]


@contextmanager
def domain_channels(session: Session, keys: TopicKeys) -> Iterator[RosChannels | None]:
    """Yield the channels of a ROS domain while the block runs; None where topics are those of a namespace."""
    if not isinstance(keys, RosKeys):
        yield None
        return
    with RosGraph(session, keys.domain) as graph:
        yield RosChannels(lambda: graph.view, keys.graph_name, lambda: graph.too_many, lambda: graph.departed.values())
