"""`replay --ros` into a client of others: any bag, with quality of service, latched messages and time.

The client is ROBOTIS', in a process of its own; the bags are written by rosbags.
"""

import hashlib
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from late_subscriber import subscribe
from ros_peer import RosPeer, ros_peer
from rosbags.interfaces import Qos as TheirQos
from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner
from waiting import wait_until

from pipeline.cli.app import app
from recorders.cdr.codec import encode
from recorders.containers.definitions import definition_hash
from recorders.errors import ConfigError, WireError
from recorders.messages.message_types import Clock, JointState, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK, JOINT_STATES
from recorders.rmw_zenoh.liveliness import EntityType
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import Durability, Qos
from recorders.wire.keys.ros_graph import RosGraph, find_graph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.playback import Playback, PlaybackConfig
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 6
STEP_NS = 10_000_000
START_NS = 1_700_000_000 * 10**9
ENDLESS = QosTime(9223372036, 854775807)
LATCHED = TheirQos(
    QosHistory.KEEP_LAST,
    2,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    ENDLESS,
    ENDLESS,
    QosLiveliness.AUTOMATIC,
    ENDLESS,
    False,
)
MAP = encode(String("map"))
STATES = [encode(JointState(number, ("a",), [0.1 * number])) for number in range(6)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, store = tmp_path_factory.mktemp("bag") / "run", get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        latched = writer.add_connection("/map", String.TYPE, typestore=store, offered_qos_profiles=[LATCHED])
        states = writer.add_connection(JOINT_STATES, JointState.TYPE, typestore=store)
        writer.write(latched, START_NS, MAP)
        for number, state in enumerate(STATES):
            writer.write(states, START_NS + number * STEP_NS, state)
    return path


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    where = free_endpoint()
    with open_session(SessionConfig(listen=(where,))):
        yield where


@pytest.fixture(scope="module")
def peer(endpoint: str) -> Iterator[RosPeer]:
    with ros_peer(endpoint, domain=DOMAIN) as peer:
        yield peer


def replay(bag: Path, endpoint: str, *options: object) -> dict[str, Any]:
    arguments = ["replay", bag, "--play", "--ros", DOMAIN, "--connect", endpoint, "--json", *options]
    run = CliRunner().invoke(app, [*map(str, arguments)])
    if run.exception is not None:
        raise run.exception
    return dict(json.loads(run.stdout))


def test_a_client_of_others_gets_what_was_recorded_and_the_time(
    bag: Path, endpoint: str, peer: RosPeer, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    for topic, kind in (("/map", String.TYPE), (JOINT_STATES, JointState.TYPE), (CLOCK, Clock.TYPE)):
        peer.ask("subscribe", topic=topic, type_name=kind, name="watcher")
    peer.settle()
    waits = [f"--wait-for={topic}=1" for topic in ("/map", JOINT_STATES, CLOCK)]
    result = replay(bag, endpoint, "--rate", 100, "--start", 0.025, "--clock-rate", 50, "--wait", 20, *waits)
    assert result["messages"] == 1 + 3 + 2
    assert f"waits for subscriptions of {CLOCK} ({Clock.TYPE}): 1 of 1 there" in caplog.messages
    assert f"subscriptions of {CLOCK}: 1 there" in caplog.messages
    wait_until(lambda: len(peer.ask("received")) == 6)
    found: dict[str, list[str]] = {}
    for topic, data in peer.ask("received"):
        found.setdefault(topic, []).append(data)
    assert found["/map"] == [MAP.hex()]
    assert found[JOINT_STATES] == [state.hex() for state in STATES[3:]]
    assert found[CLOCK] == [encode(Clock(START_NS + step * STEP_NS)).hex() for step in (2, 4)]


def test_nobody_is_played_to_who_does_not_come(bag: Path, endpoint: str) -> None:
    with pytest.raises(
        WireError, match=r"/map: expected 99 subscriptions to std_msgs/msg/String within 0\.\d+ s, found"
    ):
        replay(bag, endpoint, "--wait-for", "/map=99", "--wait", 0.2)
    with pytest.raises(WireError, match=r"--wait-for /nothing: .* there are: /joint_states, /map"):
        replay(bag, endpoint, "--wait-for", "/nothing=1")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--wait-for", "/map"], "--wait-for: expected TOPIC=N, such as"),
        (["--wait-for", "/map=many"], "--wait-for: expected TOPIC=N, such as"),
        (["--wait-for", "/map=0"], "--wait-for /map: expected 1 subscription or more, found 0"),
        (["--batch-size", 64], "--batch-size: expected 1 with --ros and --play, .*, found 64"),
        (["--clock-rate", 10], "--clock-rate: expected --play and --rate beside it"),
        (["--clock-rate", 0, "--rate", 1], r"--clock-rate: expected 0\.001 to 10000 Hz, found 0"),
    ],
)
def test_options_that_mean_nothing_are_refused(bag: Path, endpoint: str, options: list[object], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        replay(bag, endpoint, *options)


def test_a_late_joiner_gets_what_is_latched_and_the_graph_states_what_was_offered(bag: Path, endpoint: str) -> None:
    playback = Playback([bag], PlaybackConfig(latched_first=True))
    keys, held, over = RosKeys(DOMAIN, NodeName("replay")), threading.Event(), threading.Event()
    sender = SenderConfig((), keys=keys, batch_size=1, qos=playback.qos)

    def in_two_parts(start: int) -> Iterator[RecordedMessage]:
        """Yield the first message, and the others when it is over."""
        stream = playback.stream(start)
        yield next(stream)
        held.set()
        assert over.wait(120.0)
        yield from stream

    with open_session(SessionConfig(connect=(endpoint,))) as session, RosGraph(session, DOMAIN) as graph:
        transport = ZenohTransport(session, config=sender, channels=playback.channels)
        thread = threading.Thread(target=transport.deliver, args=(playback.offer(), in_two_parts))
        thread.start()
        try:
            assert held.wait(120.0)
            with subscribe(endpoint, keys.key("/map", String.TYPE)) as late:
                found = json.loads(late.communicate(timeout=120)[0].splitlines()[-1])
            offered = {topic: _only_qos(graph, topic) for topic in ("/map", JOINT_STATES)}
        finally:
            over.set()
            thread.join()
    assert found["sha256"] == [hashlib.sha256(MAP).hexdigest()]
    assert offered == {"/map": Qos(durability=Durability.TRANSIENT_LOCAL, depth=2), JOINT_STATES: Qos()}


def _only_qos(graph: RosGraph, topic: str) -> Qos:
    (token,) = graph.view.endpoints(topic, EntityType.PUBLISHER)
    assert token.endpoint is not None
    return token.endpoint.qos


def test_a_topic_of_history_keep_all_is_played_with_what_was_published_before(tmp_path: Path, endpoint: str) -> None:
    keeps_all = LATCHED._replace(history=QosHistory.KEEP_ALL, depth=0)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/map", String.TYPE, typestore=store, offered_qos_profiles=[keeps_all])
        for step in range(3):
            writer.write(connection, START_NS + step * STEP_NS, MAP)
    playback = Playback([tmp_path / "bag"], PlaybackConfig(latched_first=True, start_ns=2 * STEP_NS))
    assert [record.log_time_ns for record in playback.stream()] == 3 * [START_NS + 2 * STEP_NS]
    assert replay(tmp_path / "bag", endpoint)["messages"] == 3


def test_a_type_of_ones_own_goes_by_the_hash_of_its_definition(tmp_path: Path, endpoint: str, peer: RosPeer) -> None:
    from rosbags.typesys import get_types_from_msg

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 width\nstd_msgs/Header header", "lab/msg/Grip"))
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection("/grip", "lab/msg/Grip", typestore=store), START_NS, bytes(30))
    got = threading.Event()
    with open_session(SessionConfig(connect=(endpoint,))) as session:
        key = f"{DOMAIN}/grip/lab::msg::dds_::Grip_/{store.hash_rihs01('lab/msg/Grip')}"
        with session.declare_subscriber(key, lambda sample: got.set()):
            find_graph(session, DOMAIN)  # an answer comes behind what was declared before
            replay(tmp_path / "bag", endpoint)
            assert got.wait(60.0)


def test_a_topic_of_two_definitions_of_one_type_is_refused_unless_nobody_looks_at_them(
    tmp_path: Path, endpoint: str
) -> None:
    """And two topics of one type have each their own."""
    from rosbags.typesys import get_types_from_msg

    for number, text in enumerate(("float64 width", "float64 width\nfloat64 force")):
        store = get_typestore(Stores.ROS2_JAZZY)
        store.register(get_types_from_msg(text, "lab/msg/Grip"))
        with Writer(tmp_path / str(number), version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            for topic in ("/grip", f"/grip{number}"):
                writer.write(writer.add_connection(topic, "lab/msg/Grip", typestore=store), START_NS, bytes(30))
    both = (tmp_path / "0", tmp_path / "1")
    apart = {channel.topic: definition_hash(channel) for channel in Playback(both).channels if channel.topic != "/grip"}
    with open_session(SessionConfig(connect=(endpoint,))) as session:
        got: set[str] = set()
        key = f"{DOMAIN}/*/lab::msg::dds_::Grip_/*"
        with session.declare_subscriber(key, lambda sample: got.add(str(sample.key_expr))):
            find_graph(session, DOMAIN)  # an answer comes behind what was declared before
            with pytest.raises(ConfigError, match="/grip: expected one definition of lab/msg/Grip, found two"):
                replay(both[0], endpoint, both[1])
            replay(both[0], endpoint, both[1], "--topic", "/grip[01]")
            wait_until(lambda: len(got) == 2)
            assert got == {f"{DOMAIN}{topic}/lab::msg::dds_::Grip_/{text}" for topic, text in apart.items()}
            replay(both[0], endpoint, both[1], "--humble")
            wait_until(lambda: f"{DOMAIN}/grip/lab::msg::dds_::Grip_/TypeHashNotSupported" in got)
