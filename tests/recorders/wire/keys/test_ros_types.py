"""Every type of message goes to a client of others and comes from it, bit by bit, and each side lists the other's."""

from collections.abc import Iterator

import numpy as np
import pytest
import zenoh
from ros_peer import RosPeer, ros_peer
from waiting import wait_until

from recorders.cdr.codec import encode
from recorders.messages.message_types import (
    MESSAGE_TYPES,
    Clock,
    Dimension,
    Float64MultiArray,
    JointState,
    Message,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.rmw_zenoh.liveliness import EntityType
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_graph import RosGraph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.subscription import LiveMessage

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 8
ODD = (np.nan, -np.inf, -0.0, 5e-324, 1 / 3, -1.7976931348623157e308)
_TRANSFORM = TransformStamped(
    2**31 * 10**9 - 1, "world", "h\N{LATIN SMALL LETTER A WITH DIAERESIS}nd", ODD[:3], ODD[2:]
)
MESSAGES: tuple[Message, ...] = (
    Clock(1_700_000_000_999_999_999),
    Float64MultiArray(np.array(ODD), dims=(Dimension("row", 2, 6), Dimension("column", 3, 3))),
    JointState(1, ("a", "", "\N{GREEK SMALL LETTER PI}"), ODD[:3], velocity=ODD[3:], frame_id="base"),
    PoseStamped(0, ODD[3:], orientation=ODD[:4], frame_id="w"),
    String("<robot name='\N{CJK UNIFIED IDEOGRAPH-624B}'/>\n"),
    TFMessage((_TRANSFORM, _TRANSFORM)),
    _TRANSFORM,
)
"""A message of each type."""

Ends = tuple[zenoh.Session, RosPeer]


@pytest.fixture(scope="module")
def ends() -> Iterator[Ends]:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, ros_peer(endpoint, domain=DOMAIN) as peer:
        yield session, peer


def topic(side: str, message: Message) -> str:
    """Return the topic of one side for a type."""
    return f"/{side}/{message.TYPE.rpartition('/')[2]}"


def topics(side: str) -> dict[str, list[str]]:
    return {topic(side, message): [message.TYPE] for message in MESSAGES}


def test_there_is_a_message_of_each_type() -> None:
    assert {message.TYPE for message in MESSAGES} == set(MESSAGE_TYPES)


def test_messages_of_each_type_reach_a_client_of_others(ends: Ends) -> None:
    session, peer = ends
    for message in MESSAGES:
        peer.ask("subscribe", topic=topic("ours", message), type_name=message.TYPE, name="listener")
    peer.settle()
    ours = RosKeys(DOMAIN, NodeName("sender", "/lab"))
    with ours.joined(session), RosGraph(session, DOMAIN) as graph:
        for message in MESSAGES:
            graph.wait_for(topic("ours", message), 1, timeout_s=60.0, type_name=message.TYPE)
            with ours.publishing(session, topic("ours", message), message.TYPE) as publisher:
                publisher.put(encode(message))
                listed = peer.ask("info", topic=topic("ours", message))["publishers"]
                assert [(each["node_namespace"], each["node_name"]) for each in listed] == [("/lab", "sender")]
                wait_until(lambda: topics("ours").items() <= dict(peer.ask("topics")).items())
    expected = sorted((topic("ours", message), encode(message).hex()) for message in MESSAGES)
    wait_until(lambda: sorted(map(tuple, peer.ask("received"))) == expected)


def test_messages_of_each_type_come_from_a_client_of_others(ends: Ends) -> None:
    session, peer = ends
    config = ReceiverConfig(name="recorder", keys=RosKeys(DOMAIN, NodeName("recorder")), live=True)
    with RosGraph(session, DOMAIN) as graph, Receiver(session, config=config) as receiver:
        for message in MESSAGES:
            peer.ask("publisher", topic=topic("theirs", message), type_name=message.TYPE, name="talker")
            peer.settle()
            for _ in range(2):
                peer.publish(topic("theirs", message), message)
        found = [receiver.next_event(60.0) for _ in range(2 * len(MESSAGES))]
        wait_until(lambda: topics("theirs").items() <= graph.view.topics.items())
        for message in MESSAGES:
            (token,) = graph.view.endpoints(topic("theirs", message), EntityType.PUBLISHER)
            assert (token.node.full_name, token.endpoint.type) == ("/talker", message.TYPE)
    live = [event for event in found if isinstance(event, LiveMessage)]
    assert [(each.record.topic, each.record.type, each.record.data) for each in live] == [
        (topic("theirs", message), message.TYPE, encode(message)) for message in MESSAGES for _ in range(2)
    ]
    numbers = [each.origin.sequence for each in live if each.origin is not None]
    assert [second - first for first, second in zip(numbers[::2], numbers[1::2], strict=True)] == [1] * len(MESSAGES)
