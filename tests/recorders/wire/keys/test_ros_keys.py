"""Topics of a ROS domain: messages of ours reach a client of others to the bit, and theirs reach us, numbered."""

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
import zenoh
from ros_peer import RosPeer, ros_peer
from waiting import wait_until
from zenoh.ext import CacheConfig, declare_advanced_publisher

from recorders.cdr.codec import encode
from recorders.errors import MessageError, WireError
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped, String
from recorders.messages.topics import JOINT_STATES, LEFT_TARGET, RIGHT_TARGET, ROBOT_DESCRIPTION, TF_STATIC
from recorders.rmw_zenoh.attachment import Attachment, unpack
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys.ros_graph import find_graph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import EVERY_TOPIC, MessagePublisher
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, has_subscribers, open_session
from recorders.wire.subscription import LiveMessage, Received, Subscription

_STATE = JointState(1_700_000_000_123_456_789, ("a", "b"), np.array([1e-300, -2.5]))
_POSE = PoseStamped(17, (0.25, -1.0, 1 / 3))


def keys(*rules: str, domain: int = 7, name: str = "ours") -> RosKeys:
    return RosKeys(domain, NodeName.remapped(name, "/", rules))


@pytest.mark.parametrize("topic", ["/joint_states", "/a/b_c", "/hand/left/target"])
def test_a_key_is_read_back_as_topic_and_type(topic: str) -> None:
    key = keys().key(topic, JointState.TYPE)
    assert key == f"7{topic}/sensor_msgs::msg::dds_::JointState_/{type_hash(JointState.TYPE)}"
    assert keys().read_key(key) == (topic, JointState.TYPE, topic, type_hash(JointState.TYPE))


def test_remapping_and_namespace_are_undone_when_a_key_is_read() -> None:
    ours = keys("joint_states:=/arm/state", "/camera:=/eye", "__ns:=/lab")
    for topic, named in {
        JOINT_STATES: "/arm/state",
        "/camera": "/eye",
        LEFT_TARGET: "/lab/hand/left/target",
        "/tf": "/tf",
        TF_STATIC: "/tf_static",
        "/other": "/other",
    }.items():
        key = ours.key(topic, JointState.TYPE)
        assert key.startswith(f"7{named}/sensor_msgs")
        assert ours.read_key(key) == (topic, JointState.TYPE, named, type_hash(JointState.TYPE))


def test_two_topics_of_a_node_under_one_name_are_refused() -> None:
    ours = keys(f"{LEFT_TARGET}:={RIGHT_TARGET}")
    with open_session(SessionConfig(listen=(free_endpoint(),))) as session, ExitStack() as stack:
        for topic in (LEFT_TARGET, LEFT_TARGET, JOINT_STATES):
            stack.enter_context(ours.announced(session, topic, JointState.TYPE))
        for declare in (ours.announced, ours.publishing):
            with pytest.raises(WireError, match=f"found {RIGHT_TARGET} for {LEFT_TARGET} and {RIGHT_TARGET}"):
                stack.enter_context(declare(session, RIGHT_TARGET, JointState.TYPE))


def test_a_topic_whose_name_is_taken_by_remapping_has_none_here() -> None:
    ours, others = keys("/camera:=/eye", "__ns:=/lab"), keys()
    for topic in ("/camera", JOINT_STATES):
        found = ours.read_key(others.key(topic, JointState.TYPE))
        assert found == ("", JointState.TYPE, topic, type_hash(JointState.TYPE))
    odd = "7/no name/sensor_msgs::msg::dds_::JointState_/" + type_hash(JointState.TYPE)
    assert ours.read_key(odd).topic == "/no name"


@pytest.mark.parametrize("topic", ["/a b", "/1", "/a//b", "/a__b", "/é", ""])
def test_a_topic_that_ros_does_not_take_has_no_key(topic: str) -> None:
    with pytest.raises(WireError, match="expected"):
        keys().key(topic, String.TYPE)


def test_a_topic_without_a_type_has_no_key() -> None:
    with pytest.raises(WireError, match="/mine: expected a topic whose type is known"):
        keys().key("/mine")


@pytest.mark.parametrize("data", [b"", b"short", bytes(33), bytes(16) + b"\x07" + bytes(16)])
def test_an_attachment_that_is_none_of_rmw_zenoh_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match="expected"):
        keys().read_attachment("/a", data)


Ends = tuple[zenoh.Session, RosPeer, str]


@pytest.fixture(scope="module")
def ends() -> Iterator[Ends]:
    pytest.importorskip("zenoh_ros2_sdk")
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, ros_peer(endpoint, domain=7) as peer:
        yield session, peer, endpoint


def test_what_we_publish_reaches_a_client_of_others_to_the_bit(ends: Ends) -> None:
    session, peer, _ = ends
    for topic, kind in ((JOINT_STATES, JointState.TYPE), ("/goal", PoseStamped.TYPE)):
        peer.ask("subscribe", topic=topic, type_name=kind, name="listener")
    peer.settle()
    ours = keys(f"{LEFT_TARGET}:=/goal")
    with ours.joined(session), TopicPublisher(session, keys=ours) as publisher:
        for _ in range(2):
            publisher.publish(JOINT_STATES, _STATE, log_time_ns=5)
        publisher.publish(LEFT_TARGET, _POSE, log_time_ns=5)
        assert peer.received(JOINT_STATES, 2) == [encode(_STATE)] * 2
        assert peer.received("/goal", 1) == [encode(_POSE)]
        info = peer.ask("info", topic="/goal")
        assert [publisher["node_name"] for publisher in info["publishers"]] == ["ours"]


def test_what_a_client_of_others_publishes_reaches_us_numbered_and_named(ends: Ends) -> None:
    session, peer, _ = ends
    config = ReceiverConfig(name="recorder", keys=keys(f"{JOINT_STATES}:=/state"), live=True)
    with Receiver(session, config=config) as receiver:
        for topic, kind in (("/state", JointState.TYPE), ("/numbers", Float64MultiArray.TYPE)):
            peer.ask("publisher", topic=topic, type_name=kind, name="talker")
        peer.settle()
        numbers = Float64MultiArray(np.array([0.1, 2.0]))
        for topic, message in (("/state", _STATE), ("/state", _STATE), ("/numbers", numbers)):
            peer.publish(topic, message)
        found = [live(receiver) for _ in range(3)]
    assert [(message.record.topic, message.record.type, message.record.sequence) for message in found] == [
        (JOINT_STATES, JointState.TYPE, 0),
        (JOINT_STATES, JointState.TYPE, 1),
        ("/numbers", Float64MultiArray.TYPE, 0),
    ]
    assert [message.record.data for message in found] == [encode(_STATE), encode(_STATE), encode(numbers)]
    assert all(message.numbered and message.origin is not None for message in found)
    first, second, other = (message.origin for message in found)
    assert first.gid == second.gid != other.gid
    assert 0 < first.source_time_ns < second.source_time_ns


def test_nodes_of_ros_2_humble_whose_keys_have_no_hashes_are_understood_both_ways(ends: Ends) -> None:
    """We receive what comes with a hash or without one; they what is published for them."""
    session, peer, _ = ends
    peer.ask("subscribe", topic="/humble", type_name=JointState.TYPE, name="old_listener", humble=True)
    for humble in (True, False):
        peer.ask("publisher", topic=f"/{humble}".lower(), type_name=JointState.TYPE, name="old", humble=humble)
    ours = RosKeys(7, NodeName("ours"), humble=True)
    config = ReceiverConfig(
        name="learner", keys=ours, live=True, topics=dict.fromkeys(("/true", "/false"), JointState.TYPE)
    )
    found: list[zenoh.Sample] = []
    with (
        ours.subscribing(session, "/true", JointState.TYPE, found.append),
        Receiver(session, config=config) as receiver,
        ours.publishing(session, "/humble", JointState.TYPE) as publisher,
    ):
        peer.settle()
        for topic in ("/true", "/false"):
            peer.publish(topic, _STATE)
        assert {live(receiver).record[:3] for _ in range(2)} == {
            (topic, JointState.TYPE, encode(_STATE)) for topic in ("/true", "/false")
        }
        wait_until(lambda: len(found) == 1)
        publisher.put(encode(_STATE))
        assert peer.received("/humble", 1) == [encode(_STATE)]


def test_beside_a_stream_messages_of_another_definition_are_refused_as_they_are_before_it(ends: Ends) -> None:
    session, _, endpoint = ends
    other = RosKeys(7, NodeName("other"), hashes={("/arm", JointState.TYPE): "RIHS01_" + 64 * "a"})
    found, refused = [], []

    def take(received: Received) -> None:
        found.append(received.sample.payload.to_bytes())

    def refuse(topic: str, reason: str) -> None:
        refused.append((topic, reason))

    wanted = {"/arm": JointState.TYPE}
    with (
        open_session(SessionConfig(connect=(endpoint,))) as there,
        Subscription(session, keys(), hand_over=take, refuse=refuse, topics=wanted, live=True) as subscription,
    ):
        subscription.take_all()
        for ours, data in ((other, b"foreign"), (keys(), b"same")):
            there.put(ours.key("/arm", JointState.TYPE), data, attachment=Attachment(1, 1, bytes(16)).pack())
        wait_until(lambda: bool(found))
    assert (found, refused) == ([b"same"], [("/arm", "another type, or another definition of it")])


def test_whoever_publishes_another_definition_is_reported_and_shown(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    """As ROS 2 has it, none of its messages come."""
    session, _, endpoint = ends
    caplog.set_level("WARNING")
    found: list[zenoh.Sample] = []
    other = RosKeys(7, NodeName("other"), hashes={("/arm", JointState.TYPE): "RIHS01_" + 64 * "a"})
    ours = keys()
    with (
        open_session(SessionConfig(connect=(endpoint,))) as there,
        ours.subscribing(session, "/arm", JointState.TYPE, found.append),
        other.publishing(there, "/arm", JointState.TYPE) as foreign,
        keys(name="same").publishing(there, "/arm", JointState.TYPE) as same,
    ):
        wait_until(lambda: "/arm: /other publishes another definition of sensor_msgs/msg/JointState" in caplog.text)
        wait_until(lambda: has_subscribers(same))
        foreign.put(b"foreign")
        same.put(b"same")
        wait_until(lambda: [sample.payload.to_bytes() for sample in found] == [b"same"])
        (row,) = (row for row in find_graph(session, 7).to_dict()["topics"] if row["topic"] == "/arm")
        hashes = ["RIHS01_" + 64 * "a", type_hash(JointState.TYPE)]
        assert row["hashes"] == {JointState.TYPE: sorted(hashes)}
        assert "/same publishes" not in caplog.text


def live(receiver: Receiver) -> LiveMessage:
    event = receiver.next_event(60.0)
    assert isinstance(event, LiveMessage)
    return event


def test_a_late_joiner_gets_what_is_latched_whoever_it_is(ends: Ends) -> None:
    session, peer, endpoint = ends
    text = String("<robot/>")
    ours = keys()
    with (
        ours.joined(session),
        ours.publishing(session, ROBOT_DESCRIPTION, String.TYPE) as publisher,
        open_session(SessionConfig(connect=(endpoint,))) as late,
    ):
        publisher.put(encode(text))
        peer.ask("subscribe", topic=ROBOT_DESCRIPTION, type_name=String.TYPE, name="viewer", latched=True)
        assert peer.received(ROBOT_DESCRIPTION, 1) == [encode(text)]
        for latched in (EVERY_TOPIC, ROBOT_DESCRIPTION):
            config = ReceiverConfig(name="late", keys=keys(), live=True, latched_topics=frozenset({latched}))
            with Receiver(late, config=config) as receiver:
                assert live(receiver).record[:4] == (ROBOT_DESCRIPTION, String.TYPE, encode(text), 1)


def stamping(endpoint: str) -> zenoh.Config:
    """Return the configuration of a client that stamps what it publishes."""
    config = zenoh.Config()
    config.insert_json5("timestamping/enabled", "true")
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def test_what_is_stamped_and_not_latched_keeps_its_order(ends: Ends) -> None:
    _, _, endpoint = ends
    config = ReceiverConfig(name="late", keys=keys(), live=True, latched_topics=frozenset({EVERY_TOPIC}))
    with (
        zenoh.open(stamping(endpoint)) as other,
        open_session(SessionConfig(connect=(endpoint,))) as late,
        Receiver(late, config=config) as receiver,
        other.declare_publisher(
            keys().key("/numbers", String.TYPE), congestion_control=zenoh.CongestionControl.BLOCK
        ) as publisher,
    ):
        wait_until(lambda: has_subscribers(publisher))
        for number in range(1, 51):
            publisher.put(b"", attachment=Attachment(number, 5, bytes(16)).pack())
        assert [live(receiver).record.sequence for _ in range(50)] == list(range(1, 51))


def test_a_latched_publisher_that_stamps_rather_than_counts_is_taken_once(ends: Ends) -> None:
    """As rmw_zenoh's own does: a cache, and sessions that stamp what they publish."""
    _, _, endpoint = ends
    key = keys().key(TF_STATIC, String.TYPE)
    with zenoh.open(stamping(endpoint)) as other, open_session(SessionConfig(connect=(endpoint,))) as late:
        publisher = declare_advanced_publisher(other, key, cache=CacheConfig(max_samples=1), publisher_detection=True)
        publisher.put(b"first", attachment=Attachment(1, 5, bytes(16)).pack())
        config = ReceiverConfig(name="late", keys=keys(), live=True, latched_topics=frozenset({EVERY_TOPIC}))
        with Receiver(late, config=config) as receiver:
            assert live(receiver).record.data == b"first"
            publisher.put(b"second", attachment=Attachment(2, 6, bytes(16)).pack())
            assert live(receiver).record.data == b"second"
            publisher.put(b"third", attachment=Attachment(3, 7, bytes(16)).pack())
            assert live(receiver).record.data == b"third"


def test_latched_publishers_of_one_session_are_all_taken_with_all_that_each_keeps(ends: Ends) -> None:
    """As those of a component container are, for late joiners; what comes then comes once."""
    _, _, endpoint = ends
    key = keys().key(TF_STATIC, String.TYPE)
    config = ReceiverConfig(name="late", keys=keys(), live=True, latched_topics=frozenset({EVERY_TOPIC}))
    with zenoh.open(stamping(endpoint)) as other, open_session(SessionConfig(connect=(endpoint,))) as late:
        publishers = [
            declare_advanced_publisher(other, key, cache=CacheConfig(max_samples=depth), publisher_detection=True)
            for depth in (1, 1, 2)
        ]
        for name, number in ((0, 1), (1, 1), (2, 1), (2, 2), (2, 3)):
            attached = Attachment(number, 5, bytes([name]) * 16).pack()
            publishers[name].put(b"%d of %d" % (number, name), attachment=attached)
        with Receiver(late, config=config) as receiver:
            cached = sorted(live(receiver).record.data for _ in range(4))
            assert cached == [b"1 of 0", b"1 of 1", b"2 of 2", b"3 of 2"]
            for name, number in ((0, 2), (1, 2), (2, 4)):
                attached = Attachment(number, 6, bytes([name]) * 16).pack()
                publishers[name].put(b"%d of %d" % (number, name), attachment=attached)
            assert [live(receiver).record.data for _ in range(3)] == [b"2 of 0", b"2 of 1", b"4 of 2"]


def test_a_publisher_numbers_from_one_and_puts_its_part_first(ends: Ends) -> None:
    session, _, _ = ends
    found: list[zenoh.Sample] = []
    ours = keys()

    def put_two(publisher: MessagePublisher) -> None:
        publisher.put(b"a", attachment=b"ours")
        publisher.put(b"b")

    with (
        ours.subscribing(session, JOINT_STATES, JointState.TYPE, found.append),
        ours.publishing(session, JOINT_STATES, JointState.TYPE) as publisher,
    ):
        put_two(publisher)
        wait_until(lambda: len(found) == 2)
    read = [unpack(sample.attachment.to_bytes()) for sample in found]
    assert [(origin.sequence, rest) for origin, rest in read] == [(1, b"ours"), (2, b"")]
    assert read[0][0].gid == read[1][0].gid
