"""Channels of a recording in a ROS domain: what the publishers of the graph state, as rosbag2 writes it."""

import logging

import pytest

from recorders.cdr.rosbags_types import schema_text
from recorders.errors import WireError
from recorders.messages.message_types import JointState, String
from recorders.messages.record import RecordedMessage
from recorders.recording.ros_channels import RosChannels
from recorders.rmw_zenoh.bag_channels import HASH_METADATA, QOS_METADATA
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType, Token
from recorders.rmw_zenoh.names import NodeName, check_topic
from recorders.rmw_zenoh.qos import LATCHED, Qos, qos_text
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys.ros_graph import GraphView

OTHER_HASH = "RIHS01_" + 64 * "a"


def publisher(topic: str, type_name: str, qos: Qos, hash_text: str = "", number: int = 1) -> Token:
    endpoint = Endpoint(topic, type_name, hash_text or type_hash(type_name), qos)
    return Token(0, "f00", 0, number, EntityType.PUBLISHER, NodeName("talker"), endpoint)


def record(topic: str, type_name: str = String.TYPE) -> RecordedMessage:
    return RecordedMessage(topic, type_name, b"", 1, 0)


class Graph:
    def __init__(self, *tokens: Token) -> None:
        self.tokens = tokens

    def channels(self) -> RosChannels:
        return RosChannels(lambda: GraphView(self.tokens), check_topic)


def test_every_publisher_of_the_type_is_stated() -> None:
    graph = Graph(
        publisher("/chatter", String.TYPE, Qos(depth=3)),
        publisher("/chatter", String.TYPE, LATCHED, number=2),
        publisher("/chatter", JointState.TYPE, Qos(depth=9), number=3),
        publisher("/other", String.TYPE, Qos(depth=8), number=4),
    )
    channel = graph.channels().channel(record("/chatter"))
    assert dict(channel.metadata) == {
        QOS_METADATA: qos_text([Qos(depth=3), LATCHED]),
        HASH_METADATA: type_hash(String.TYPE),
    }
    assert channel.schema == (String.TYPE, "ros2msg", schema_text(String.TYPE).encode())


def test_a_type_of_ones_own_has_its_name_and_hash() -> None:
    channel = (
        Graph(publisher("/grip", "lab/msg/Grip", Qos(), OTHER_HASH)).channels().channel(record("/grip", "lab/msg/Grip"))
    )
    assert (channel.type, channel.schema, dict(channel.metadata)[HASH_METADATA]) == (
        "lab/msg/Grip",
        ("lab/msg/Grip", "", b""),
        OTHER_HASH,
    )


def test_a_channel_stays_as_it_began_and_a_newcomer_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    first, same, other = (
        publisher("/chatter", String.TYPE, qos, number=number) for number, qos in enumerate((Qos(), Qos(), LATCHED))
    )
    graph = Graph(first)
    channels = graph.channels()
    channel = channels.channel(record("/chatter"))
    with caplog.at_level(logging.WARNING):
        graph.tokens = (first, same)
        assert [channels.node_of(record("/chatter"), each.gid) for each in (first, same)] == ["/talker", "/talker"]
        assert channels.node_of(record("/chatter"), bytes(16)) == ""
        assert not caplog.records
        graph.tokens = (first, same, other)
        assert channels.node_of(record("/chatter"), other.gid) == "/talker"
        channels.node_of(record("/chatter"), other.gid)
    (line,) = caplog.messages
    assert line.startswith("/chatter: /talker came later and offers another quality of service")
    assert channels.channel(record("/chatter")) is channel


def test_definitions_that_differ_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    graph = Graph(
        publisher("/chatter", String.TYPE, Qos(), OTHER_HASH), publisher("/chatter", String.TYPE, Qos(), number=2)
    )
    with caplog.at_level(logging.WARNING):
        channel = graph.channels().channel(record("/chatter"))
    assert "different definitions of std_msgs/msg/String" in caplog.text
    assert (dict(channel.metadata)[HASH_METADATA], channel.schema) == (OTHER_HASH, (String.TYPE, "", b""))


def test_what_a_key_states_is_stated_by_the_channel_and_each_definition_has_its_own() -> None:
    qos, other_qos = Qos(depth=3), Qos(depth=4)
    graph = Graph(
        publisher("/chatter", String.TYPE, qos), publisher("/chatter", String.TYPE, other_qos, OTHER_HASH, number=2)
    )
    channels = graph.channels()
    ours, other = (channels.channel(record("/chatter"), text) for text in (type_hash(String.TYPE), OTHER_HASH))
    assert dict(ours.metadata) == {QOS_METADATA: qos_text([qos]), HASH_METADATA: type_hash(String.TYPE)}
    assert dict(other.metadata) == {QOS_METADATA: qos_text([other_qos]), HASH_METADATA: OTHER_HASH}
    assert other.schema == (String.TYPE, "", b"")
    unlisted = Graph().channels().channel(record("/chatter"), OTHER_HASH)
    assert (dict(unlisted.metadata)[HASH_METADATA], unlisted.schema) == (OTHER_HASH, (String.TYPE, "", b""))


@pytest.mark.parametrize("topic", ["/nobody", "/not a name"])
def test_a_topic_of_nobody_states_nothing(topic: str) -> None:
    if topic == "/not a name":
        with pytest.raises(WireError):
            check_topic(topic)
    channel = Graph(publisher("/chatter", String.TYPE, Qos())).channels().channel(record(topic))
    assert dict(channel.metadata) == {QOS_METADATA: "", HASH_METADATA: ""}
    assert channel.type == String.TYPE
