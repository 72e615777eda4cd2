"""`status --ros`: the graph of a ROS domain on the terminal, as a client of others fills it."""

import json
from io import StringIO
from pathlib import Path

import pytest
from here import reenact_here
from processes import complaint
from rich.console import Console
from ros_peer import ros_peer
from waiting import wait_until

from pipeline.terminal.graph_table import graph_table
from recorders.messages.message_types import JointState, String
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType, Token
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import Qos
from recorders.rmw_zenoh.type_hashes import UNKNOWN_HASH, type_hash
from recorders.wire.keys.ros_graph import GraphView, find_graph
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

pytest.importorskip("zenoh_ros2_sdk")


def test_topics_are_listed_with_types_and_nodes(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, ros_peer(endpoint, domain=3) as peer:
        peer.ask("publisher", topic="/joint_states", type_name=JointState.TYPE, name="arm")
        peer.ask("subscribe", topic="/chatter", type_name=String.TYPE, name="listener")
        wait_until(lambda: len(find_graph(session, 3).topics) == 2)
        printed = reenact_here("status", "--ros", "3", "--connect", endpoint, "--json", cwd=tmp_path)
        shown = reenact_here("status", "--connect", endpoint, "--ros", "3", cwd=tmp_path)
        other = reenact_here("status", "--ros", "--connect", endpoint, "--json", cwd=tmp_path)
    chatter, states = ({kind: [type_hash(kind)]} for kind in (String.TYPE, JointState.TYPE))
    assert json.loads(printed.stdout) == {
        "domain": 3,
        "nodes": ["/arm", "/listener"],
        "topics": [
            {
                "topic": "/chatter",
                "types": [String.TYPE],
                "hashes": chatter,
                "publishers": [],
                "subscriptions": ["/listener"],
            },
            {
                "topic": "/joint_states",
                "types": [JointState.TYPE],
                "hashes": states,
                "publishers": ["/arm"],
                "subscriptions": [],
            },
        ],
    }
    assert [row.split() for row in shown.stdout.splitlines()[1:]] == [
        ["/chatter", String.TYPE, "-", "/listener"],
        ["/joint_states", JointState.TYPE, "/arm", "-"],
    ]
    assert (other.returncode, json.loads(other.stdout)) == (1, {"domain": 0, "nodes": [], "topics": []})
    assert f"no node is in ROS domain 0 at {endpoint}" in other.stderr


def test_where_nothing_listens_the_router_of_rmw_zenoh_is_named(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    looked = reenact_here("status", "--ros", "7", "--connect", endpoint, "--wait", "0", cwd=tmp_path)
    assert (looked.returncode, looked.stdout) == (1, "")
    assert looked.stderr == (
        f"no node is in ROS domain 7: nothing listens at {endpoint}; start the router of rmw_zenoh there, "
        "`ros2 run rmw_zenoh_cpp rmw_zenohd`, or give another --connect\n"
    )


def test_names_of_hostile_tokens_are_shown_as_they_are() -> None:
    endpoint = Endpoint("/[/x]\x1b[31m/[red]", String.TYPE, type_hash(String.TYPE), Qos())
    token = Token(0, "f00", 0, 1, EntityType.PUBLISHER, NodeName("talker"), endpoint)
    written = StringIO()
    Console(file=written, width=80).print(graph_table(GraphView((token,))))
    shown = written.getvalue()
    assert "\x1b" not in shown
    assert "/[/x]\\x1b[31m/[red]" in shown


def test_nodes_without_topics_are_named_below_the_topics() -> None:
    endpoint = Endpoint("/a", String.TYPE, type_hash(String.TYPE), Qos())
    tokens = (
        Token(0, "f00", 0, 1, EntityType.PUBLISHER, NodeName("talker"), endpoint),
        Token(0, "f00", 0, 0, EntityType.NODE, NodeName("talker")),
        Token(0, "f00", 1, 0, EntityType.NODE, NodeName("idle")),
    )
    written = StringIO()
    Console(file=written, width=80).print(graph_table(GraphView(tokens)))
    assert written.getvalue().splitlines()[-1].strip() == "nodes without topics: /idle"


def test_two_definitions_of_a_type_are_shown_on_one_topic() -> None:
    hashes = type_hash(String.TYPE), UNKNOWN_HASH
    tokens = [
        Token(0, "f00", 0, number, EntityType.PUBLISHER, NodeName("talker"), Endpoint("/a", String.TYPE, each, Qos()))
        for number, each in enumerate(hashes)
    ]
    for count, shown in ((1, String.TYPE), (2, f"{String.TYPE} (2 definitions)")):
        written, view = StringIO(), GraphView(tuple(tokens[:count]))
        Console(file=written, width=200).print(graph_table(view))
        assert f"/a     {shown}  " in written.getvalue()
        assert view.to_dict()["topics"][0]["hashes"] == {String.TYPE: sorted(hashes[:count])}


def test_the_domain_of_the_environment_is_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "a lab")
    assert "ROS_DOMAIN_ID: expected 0 to 232, found 'a lab'" in complaint(reenact_here("status", "--ros", cwd=tmp_path))
