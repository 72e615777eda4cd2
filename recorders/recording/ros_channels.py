"""Channels of what is recorded in a ROS domain: type, hash and quality of service, as the graph states them."""

import logging
from collections.abc import Callable, Collection

from recorders.errors import WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.rmw_zenoh.bag_channels import bag_channel
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType
from recorders.rmw_zenoh.qos import Qos
from recorders.text.once import OnceWarner
from recorders.text.wording import escape_control
from recorders.wire.keys.ros_graph import GraphView
from recorders.writing.writer import MAX_CHANNELS

logger = logging.getLogger(__name__)

_MAX_LINES = 100  # anyone may publish on as many topics as they like


class RosChannels:
    """The channel of each topic: as its publishers were when the first message came, and the same in every file.

    Parameters
    ----------
    view : callable
        The graph as it is now.
    graph_name : callable
        The name in the graph of a topic that is recorded; raises WireError if it can have none there.
    """

    def __init__(self, view: Callable[[], GraphView], graph_name: Callable[[str], str]) -> None:
        self._view = view
        self._graph_name = graph_name
        self._channels: dict[tuple[str, str], DeclaredChannel] = {}
        self._offered: dict[tuple[str, str], frozenset[Qos]] = {}
        self._warnings = OnceWarner(logger, limit=_MAX_LINES)

    def channel(self, record: RecordedMessage) -> DeclaredChannel:
        """Return the channel of a message."""
        key = record.topic, record.type
        found = self._channels.get(key)
        if found is None:
            found = self._declared(*key)
            if len(self._channels) < MAX_CHANNELS:
                self._channels[key] = found
        return found

    def check(self) -> None:
        """Report topics on which another quality of service is offered by now than their channels state."""
        view = self._view()
        for (topic, kind), stated in self._offered.items():
            if {end.qos for end in self._publishers(view, topic, kind)} - stated:
                self._warnings.warn(
                    f"{escape_control(topic)}: a publisher that came later offers another quality of service; the "
                    "recording states that of those which were there first"
                )

    def _declared(self, topic: str, kind: str) -> DeclaredChannel:
        publishers = self._publishers(self._view(), topic, kind)
        profiles = [end.qos for end in publishers]
        if len(self._offered) < MAX_CHANNELS:
            self._offered[topic, kind] = frozenset(profiles)
        hashes = dict.fromkeys(end.type_hash for end in publishers)
        if len(hashes) > 1:
            self._warnings.warn(
                f"{escape_control(topic)}: its publishers have different definitions of {kind}: their messages are "
                "recorded as those of the first"
            )
        return bag_channel(topic, kind, next(iter(hashes), ""), profiles)

    def _publishers(self, view: GraphView, topic: str, kind: str) -> Collection[Endpoint]:
        try:
            name = self._graph_name(topic)
        except WireError:
            return ()
        tokens = view.endpoints(name, EntityType.PUBLISHER)
        return [token.endpoint for token in tokens if token.endpoint is not None and token.endpoint.type == kind]
