"""The graph of a ROS domain: a client of others lists our nodes, we list its, and a node that dies is gone."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import zenoh
from ros_peer import RosPeer, ros_peer
from waiting import wait_until

from recorders.errors import WireError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.rmw_zenoh.liveliness import EntityType
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import LATCHED, Qos
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys import ros_graph
from recorders.wire.keys.ros_graph import RosGraph, find_graph
from recorders.wire.keys.ros_node import RosNode
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

pytest.importorskip("zenoh_ros2_sdk")

Graph = tuple[zenoh.Session, RosGraph, RosPeer]


@pytest.fixture(scope="module")
def graph() -> Iterator[Graph]:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        RosGraph(session, 7) as graph,
        ros_peer(endpoint, domain=7) as peer,
    ):
        yield session, graph, peer


def test_a_client_of_others_lists_our_node_with_its_topics_and_types(graph: Graph) -> None:
    session, _, peer = graph
    node = RosNode(7, NodeName.remapped("serve", "/lab", ["/hand/left/target:=/goal"]))
    goal = node.name.resolve("/hand/left/target")
    with (
        node.joined(session),
        node.declared(session, EntityType.PUBLISHER, "/joint_commands", JointState.TYPE, Qos()),
        node.declared(session, EntityType.SUBSCRIPTION, goal, PoseStamped.TYPE, Qos(depth=3)),
        node.declared(session, EntityType.PUBLISHER, "/robot_description", String.TYPE, LATCHED),
    ):
        found = dict(peer.ask("topics"))
        assert found["/joint_commands"] == [JointState.TYPE]
        assert found["/goal"] == [PoseStamped.TYPE]
        info = peer.ask("info", topic="/robot_description")
        (publisher,) = info["publishers"]
        assert (publisher["node_name"], publisher["node_namespace"]) == ("serve", "/lab")
        assert publisher["qos"] == ":1:,1:,:,:,,"
    assert "/goal" not in dict(peer.ask("topics"))


def test_we_list_a_client_of_others(graph: Graph) -> None:
    session, ours, peer = graph
    peer.ask("publisher", topic="/chatter", type_name=String.TYPE, name="talker")
    peer.ask("subscribe", topic="/hand/right/target", type_name=PoseStamped.TYPE, name="listener")
    wait_until(lambda: {"/chatter", "/hand/right/target"} <= set(ours.view.topics))
    assert ours.view.topics["/chatter"] == [String.TYPE]
    assert {"/talker", "/listener"} <= set(ours.view.nodes)
    assert find_graph(session, 7) == ours.view
    hashes = {String.TYPE: [type_hash(String.TYPE)]}
    sides: dict[str, list[str]] = {"publishers": ["/talker"], "subscriptions": []}
    chatter = {"topic": "/chatter", "types": [String.TYPE], "hashes": hashes, **sides}
    assert chatter in ours.view.to_dict()["topics"]
    (token,) = ours.view.endpoints("/hand/right/target", EntityType.SUBSCRIPTION)
    assert token.endpoint.qos == Qos()
    ours.wait_for("/hand/right/target", 1, timeout_s=0.0)
    ours.wait_for("/hand/right/target", 1, timeout_s=0.0, type_name=PoseStamped.TYPE)
    with pytest.raises(WireError, match="target: expected 1 subscriptions to std_msgs/msg/String within 0 s, found 0"):
        ours.wait_for("/hand/right/target", 1, timeout_s=0.0, type_name=String.TYPE)
    with pytest.raises(WireError, match="/chatter: expected 2 subscriptions within 0 s, found 0"):
        ours.wait_for("/chatter", 2, timeout_s=0.0)


def test_a_node_that_dies_is_gone_from_the_graph(graph: Graph) -> None:
    _, ours, peer = graph
    peer.ask("publisher", topic="/mortal", type_name=String.TYPE, name="mortal")
    wait_until(lambda: "/mortal" in ours.view.topics)
    peer.process.kill()
    wait_until(lambda: "/mortal" not in ours.view.topics)
    assert "/mortal" not in ours.view.nodes


def test_what_is_no_token_is_counted_and_does_no_harm(graph: Graph) -> None:
    session, ours, _ = graph
    with session.liveliness().declare_token("@ros2_lv/7/x/0/0/NN/%/%/1 2"):
        wait_until(lambda: ours.refused)
    assert "/1 2" not in ours.view.nodes


def test_tokens_are_remembered_up_to_a_limit_however_many_there_are(
    graph: Graph, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Of those beyond it there is one line, and an error that they may be the cause of counts them."""
    session, limit = graph[0], 20
    monkeypatch.setattr(ros_graph, "MAX_TOKENS", limit)
    with ExitStack() as many, RosGraph(session, 6) as ours:
        for number in range(3 * limit):
            many.enter_context(RosNode(6, NodeName(f"node_{number}")).joined(session))
        many.enter_context(session.liveliness().declare_token("@ros2_lv/6/" + "x/" * 3000 + "x"))
        wait_until(lambda: ours.refused == 2 * limit + 1)
        assert len(ours.view.tokens) == len(find_graph(session, 6).tokens) == limit
        (line,) = (message for message in caplog.messages if "ROS domain 6" in message)
        assert line.startswith("ROS domain 6: more than 20 tokens in its graph")
        assert ours.too_many == 2 * limit + 1
        with pytest.raises(WireError, match="found 0; 41 tokens beyond 20 are not known"):
            ours.wait_for("/chatter", 1, timeout_s=0.0)
        many.close()
        wait_until(lambda: not ours.view.tokens)
