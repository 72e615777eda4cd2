"""A recording of a ROS domain is a bag: types, hashes, quality of service, numbers and times as they were sent.

The client is ROBOTIS', in a process of its own; what it publishes is read back by rosbags.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh
from ros_peer import RosPeer, ros_peer
from rosbags.highlevel import AnyReader
from waiting import wait_until

from recorders.cdr.codec import encode
from recorders.messages.message_types import Clock, JointState, String
from recorders.messages.record import publish_time_ns
from recorders.messages.topics import CLOCK, JOINT_STATES
from recorders.reading.reader import LogReader
from recorders.recording.bag_folder import new_bag_folder, write_bag_metadata
from recorders.recording.config import RecordConfig, RecordingStats
from recorders.recording.live_recorder import LiveRecorder
from recorders.recording.ros_channels import TOO_MANY_TOKENS, domain_channels
from recorders.recording.ros_subscriptions import recorded_topics
from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.bag_channels import HASH_METADATA, has_definition
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import LATCHED, Durability, Qos, Reliability
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys import ros_graph
from recorders.wire.keys.ros_graph import RosGraph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import EVERY_TOPIC
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, has_subscribers, open_session

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 5
CONFIG = RecordConfig(for_rosbag2=True)
Beside = tuple[zenoh.Session, RosPeer, zenoh.Session]


@pytest.fixture(scope="module")
def beside() -> Iterator[Beside]:
    """A session of ours, the client beside it, and another session of ours."""
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        ros_peer(endpoint, domain=DOMAIN) as peer,
        open_session(SessionConfig(connect=(endpoint,))) as other,
    ):
        yield session, peer, other


@contextmanager
def recording(session: zenoh.Session, out: Path, config: RecordConfig = CONFIG) -> Iterator[RecordingStats]:
    """Record the domain to a file while the block runs."""
    keys = RosKeys(DOMAIN, NodeName("recorder"))
    receiving = ReceiverConfig(name="recorder", keys=keys, live=True, latched_topics=frozenset({EVERY_TOPIC}))
    over = threading.Event()
    with (
        keys.joined(session),
        domain_channels(session, keys) as channels,
        Receiver(session, config=receiving) as receiver,
        LiveRecorder(out, config=config, ros=channels) as recorder,
        recorded_topics(session, keys, channels, config.wants) as published,
    ):
        thread = threading.Thread(target=recorder.run, args=(receiver,), kwargs={"stopped": over.is_set})
        thread.start()
        try:
            yield recorder.recording
        finally:
            over.set()
            thread.join()
            recorder.recording.note_published(published)


def came(stats: RecordingStats, number: int) -> Callable[[], bool]:
    return lambda: stats.messages == number


def test_a_bag_has_what_a_client_of_others_published(beside: Beside, tmp_path: Path) -> None:
    session, peer, _ = beside
    path = new_bag_folder(tmp_path / "bag")
    states = [encode(JointState(number, ("a",), [0.1 * number])).hex() for number in range(5)]
    peer.ask("publisher", topic="/map", type_name=String.TYPE, name="mapper", latched=True)
    with recording(session, path) as stats:
        peer.settle()
        peer.ask("publish", topic="/map", fields={"data": "latched"})
        peer.ask("publisher", topic=JOINT_STATES, type_name=JointState.TYPE, name="arm")
        for state in states:
            peer.ask("publish_cdr", topic=JOINT_STATES, payload=state)
        wait_until(came(stats, 6))
    write_bag_metadata(stats.paths)
    with AnyReader([tmp_path / "bag"]) as reader:
        found = {connection.topic: connection for connection in reader.connections}
        messages = [(connection.topic, bytes(data).hex()) for connection, _, data in reader.messages()]
    assert messages == [("/map", encode(String("latched")).hex()), *((JOINT_STATES, state) for state in states)]
    for topic, kind, durability in (("/map", String.TYPE, 1), (JOINT_STATES, JointState.TYPE, 2)):
        (profile,) = found[topic].ext.offered_qos_profiles
        assert (found[topic].msgtype, found[topic].digest) == (kind, type_hash(kind))
        assert (profile.durability.value, profile.reliability.value) == (durability, 1)
    log = LogReader(path)
    numbers = [record.sequence for record in log.records(topics=(JOINT_STATES,))]
    assert numbers == list(range(numbers[0], numbers[0] + 5))
    for record in log.records(publish_times=True):
        assert publish_time_ns(record) < record.log_time_ns
    rows = {row["topic"]: row for row in log.manifest["publishers"]}
    assert stats.to_dict()["publishers"] == log.manifest["publishers"]
    assert (rows[JOINT_STATES]["messages"], rows[JOINT_STATES]["missing"], stats.gaps) == (5, 0, {})
    assert {topic: row["node"] for topic, row in rows.items()} == {"/map": "/mapper", JOINT_STATES: "/arm"}


def test_a_publisher_that_is_gone_when_its_message_is_taken_is_named(beside: Beside, tmp_path: Path) -> None:
    session, _, other = beside
    keys = RosKeys(DOMAIN, NodeName("brief"))
    receiving = ReceiverConfig(name="recorder", keys=RosKeys(DOMAIN, NodeName("recorder")), live=True)
    with (
        RosGraph(session, DOMAIN) as graph,
        domain_channels(session, keys) as channels,
        Receiver(session, config=receiving) as receiver,
        LiveRecorder(tmp_path / "log.mcap", ros=channels) as recorder,
    ):
        with keys.publishing(other, "/once", String.TYPE) as publisher:
            wait_until(lambda: "/once" in graph.view.topics and has_subscribers(publisher))
            publisher.put(encode(String("once")))
        wait_until(lambda: "/once" not in graph.view.topics)
        assert channels is not None
        wait_until(lambda: "/once" not in channels.view().topics)
        recorder.run(receiver, stopped=lambda: recorder.recording.messages == 1)
    assert [row["node"] for row in recorder.recording.publishers.rows()] == ["/brief"]


def test_a_recorder_subscribes_to_each_topic_that_it_records_and_is_counted_there(
    beside: Beside, tmp_path: Path
) -> None:
    """With what matches all its publishers; to those that come later too, and to none when it is over."""
    session, peer, other = beside
    keys = RosKeys(DOMAIN, NodeName("talker"))
    best_effort = Qos(Reliability.BEST_EFFORT)

    def requested(topic: str) -> list[str]:
        return [row["qos"] for row in (peer.ask("info", topic=topic) or {"subscribers": []})["subscribers"]]

    with RosGraph(other, DOMAIN) as graph, keys.publishing(other, "/first", String.TYPE):
        with recording(session, tmp_path / "log.mcap", replace(CONFIG, exclude=("/left_out",))) as stats:
            graph.wait_for("/first", 1, timeout_s=120.0, type_name=String.TYPE)
            with (
                keys.publishing(other, "/left_out", String.TYPE),
                keys.publishing(other, "/latched", String.TYPE, qos=LATCHED),
                keys.publishing(other, "/later", String.TYPE, qos=best_effort),
                keys.publishing(other, "/first", String.TYPE, qos=best_effort),
            ):
                for topic in ("/latched", "/later"):
                    graph.wait_for(topic, 1, timeout_s=120.0)
                wait_until(lambda: requested("/first") == [best_effort.to_token()])
                assert requested("/latched") == [Qos(durability=Durability.TRANSIENT_LOCAL).to_token()]
                assert requested("/left_out") == []
            wait_until(lambda: requested("/later") == [])
            wait_until(lambda: requested("/first") == [Qos().to_token()])
        wait_until(lambda: graph.subscriptions("/first") == 0)
        assert {"/first", "/latched", "/later"} <= set(stats.silent)  # none of them published a message
        assert "/left_out" not in stats.silent


def put(session: zenoh.Session, keys: RosKeys, topic: str, message: String | Clock, origin: Attachment) -> None:
    session.put(keys.key(topic, message.TYPE), encode(message), attachment=origin.pack())


def test_what_does_not_come_of_one_of_two_publishers_is_counted(beside: Beside, tmp_path: Path) -> None:
    """And a message of a type that is not known keeps its name; the log's own number wraps where MCAP's ends."""
    session, _, other = beside
    keys = RosKeys(DOMAIN, NodeName("talker"), hashes={("/grip", "lab/msg/Grip"): "RIHS01_" + 64 * "5"})
    gids = bytes(15) + b"a", bytes(15) + b"b"
    with recording(session, tmp_path / "log.mcap") as stats:
        for number, gid in ((1, 0), (2**32 - 1, 1), (2, 0), (2**32, 1), (6, 0), (2**32 + 1, 1)):
            put(other, keys, "/chatter", String(str(number)), Attachment(number, number, gids[gid]))
        other.put(keys.key("/grip", "lab/msg/Grip"), b"?", attachment=Attachment(1, 7, gids[0]).pack())
        wait_until(came(stats, 7))
    log = LogReader(tmp_path / "log.mcap")
    assert [record.sequence for record in log.records(topics=("/chatter",))] == [1, 2**32 - 1, 2, 0, 6, 1]
    assert stats.gaps == {"/chatter": 3}
    kept = ("topic", "publisher", "first", "last", "missing")
    assert [tuple(row[name] for name in kept) for row in stats.publishers.rows()] == [
        ("/chatter", gids[0].hex(), 1, 6, 3),
        ("/chatter", gids[1].hex(), 2**32 - 1, 2**32 + 1, 0),
        ("/grip", gids[0].hex(), 1, 1, 0),
    ]
    assert (log.topics["/grip"], stats.opaque) == ("lab/msg/Grip", {"/grip": 1})


def test_what_is_no_message_of_the_type_that_its_key_states_is_counted_and_keeps_its_channel(
    beside: Beside, tmp_path: Path
) -> None:
    """Bytes of no message, and a definition that is not ours."""
    session, _, other = beside
    keys = RosKeys(DOMAIN, NodeName("talker"))
    hashes = {(topic, JointState.TYPE): "RIHS01_" + 64 * "a" for topic in ("/arm", JOINT_STATES)}
    foreign = RosKeys(DOMAIN, NodeName("talker"), hashes=hashes)
    state = encode(JointState(1, ("a",), [0.5]))
    sent = [
        ("/chatter", keys.key("/chatter", String.TYPE), b"\xff\xff"),
        ("/chatter", keys.key("/chatter", String.TYPE), encode(String("a"))),
        ("/arm", foreign.key("/arm", JointState.TYPE), state),
        (JOINT_STATES, foreign.key(JOINT_STATES, JointState.TYPE), state),
        (JOINT_STATES, keys.key(JOINT_STATES, JointState.TYPE), state),
        (JOINT_STATES, keys.key(JOINT_STATES, JointState.TYPE), b"\xff\xff"),
    ]
    with recording(session, tmp_path / "log.mcap") as stats:
        for number, (_, key, data) in enumerate(sent):
            other.put(key, data, attachment=Attachment(number + 1, 7, bytes(16)).pack())
        wait_until(came(stats, len(sent)))
    assert stats.opaque == {"/chatter": 1, "/arm": 1, JOINT_STATES: 2}
    log = LogReader(tmp_path / "log.mcap")
    assert sorted((record.topic, record.data) for record in log) == sorted((topic, data) for topic, _, data in sent)
    found = sorted((each.topic, dict(each.metadata)[HASH_METADATA], has_definition(each)) for each in log.channels)
    assert found == [
        ("/arm", "RIHS01_" + 64 * "a", False),
        ("/chatter", type_hash(String.TYPE), True),
        (JOINT_STATES, type_hash(JointState.TYPE), True),
        (JOINT_STATES, "RIHS01_" + 64 * "a", False),
    ]


def test_publishers_that_are_too_many_for_the_graph_are_counted(
    beside: Beside, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, _, other = beside
    monkeypatch.setattr(ros_graph, "MAX_TOKENS", 0)
    keys = RosKeys(DOMAIN, NodeName("talker"))
    with recording(session, tmp_path / "log.mcap") as stats, keys.joined(other):
        put(other, keys, "/chatter", String("a"), Attachment(1, 7, bytes(16)))
        wait_until(came(stats, 1))
    assert stats.refused.keys() == {TOO_MANY_TOKENS}
    assert stats.refused[TOO_MANY_TOKENS] >= 1


def test_log_times_are_those_of_the_domain_where_asked(beside: Beside, tmp_path: Path) -> None:
    session, _, other = beside
    keys = RosKeys(DOMAIN, NodeName("player"))
    sent = [String("early"), Clock(1000), String("a"), String("b"), Clock(2000), String("c"), Clock(1500), String("d")]
    with recording(session, tmp_path / "log.mcap", replace(CONFIG, use_sim_time=True)) as stats:
        for number, message in enumerate(sent):
            topic = CLOCK if isinstance(message, Clock) else "/chatter"
            put(other, keys, topic, message, Attachment(number, 77, bytes(16)))
            wait_until(lambda taken=number + 1: stats.messages + stats.refused.total() == taken)  # type: ignore[misc]
    found = [(record.topic, record.log_time_ns) for record in LogReader(tmp_path / "log.mcap")]
    assert found == [
        (CLOCK, 1000),
        ("/chatter", 1000),
        ("/chatter", 1000),
        (CLOCK, 2000),
        ("/chatter", 2000),
        (CLOCK, 2000),  # which stepped back: log time waits
        ("/chatter", 2000),
    ]
    assert stats.refused == {"all topics: before the first message of /clock": 1}
