"""Topic names are ROS 2's, and are resolved as ROS 2 does; a client of others is asked about random ones."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.errors import MessageError, WireError
from recorders.rmw_zenoh.keys import TopicKey
from recorders.rmw_zenoh.liveliness import mangle
from recorders.rmw_zenoh.names import NodeName, check_topic
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys.ros_keys import RosKeys

ros2 = pytest.importorskip("pamoja.ros2")

STRING = "std_msgs/msg/String"
PIECES = ["a", "B", "7", "_", "__", "/", "//", "~", " ", "é", "\N{GREEK SMALL LETTER PI}", "{ns}", "-.", "%", "*"]


@settings(max_examples=1000)
@given(pieces=st.lists(st.sampled_from(PIECES), max_size=8))
def test_keys_are_those_of_another_client_and_what_it_refuses_is_refused(pieces):
    topic = "".join(pieces)
    theirs = ros2.entity_key(3, topic, STRING, type_hash(STRING))
    try:
        ours = TopicKey(3, topic, STRING, type_hash(STRING)).to_text()
    except (WireError, MessageError):
        ours = None
    assert ours == theirs


def test_keys_of_random_names_of_each_form_are_those_of_another_client():
    """Relative, absolute, private and substituted ones, remapped or not, in the namespace of a node."""
    draw = random.Random(11)

    def path() -> str:
        return "/".join(draw.choice("abXY_") + draw.choice(["", "7", "k_k", "Zz9"]) for _ in range(draw.randint(1, 3)))

    for _ in range(1000):
        name, namespace = path().partition("/")[0], path()
        topic, other = (draw.choice([path(), "/" + path(), "~/" + path(), "{ns}/" + path(), "~"]) for _ in range(2))
        rules = [f"{topic}:={other}"] if draw.random() < 0.5 else []
        expected = absolute(other if rules else topic, name, namespace)
        key = RosKeys(3, NodeName.remapped(name, f"/{namespace}", rules)).key(topic, STRING)
        assert key == ros2.entity_key(3, expected, STRING, type_hash(STRING))
        assert mangle(expected) == ros2.percent_mangle(expected)


def absolute(form: str, name: str, namespace: str) -> str:
    """Return what a name of a node's stands for, by hand."""
    for begin, at in (("{ns}/", f"/{namespace}/"), ("~/", f"/{namespace}/{name}/"), ("/", "/")):
        if form.startswith(begin):
            return at + form[len(begin) :]
    return f"/{namespace}/{name}" if form == "~" else f"/{namespace}/{form}"


@settings(max_examples=300)
@given(names=st.lists(st.from_regex(r"[A-Za-z_][A-Za-z0-9]{0,8}", fullmatch=True), min_size=1, max_size=4))
def test_a_key_is_read_back(names):
    key = TopicKey(0, "/" + "/".join(names), STRING, type_hash(STRING))
    assert TopicKey.from_text(key.to_text()) == key


@pytest.mark.parametrize(
    ("topic", "absolute"),
    [
        ("/joint_states", "/joint_states"),
        ("joint_states", "/lab/joint_states"),
        ("~/state", "/lab/learn/state"),
        ("~", "/lab/learn"),
        ("{ns}/{node}/x", "/lab/learn/x"),
    ],
)
def test_a_relative_name_is_in_the_namespace_and_a_private_one_below_the_node(topic, absolute):
    assert NodeName("learn", "/lab").expand(topic) == absolute


@pytest.mark.parametrize(
    "topic", ["", "/", "/a/", "//a", "a b", "/a/~", "~x", "{other}/x", "/1", "/a__b", "/" + "a" * 300]
)
def test_what_is_no_name_is_refused(topic):
    with pytest.raises(WireError, match="ROS topic: expected"):
        NodeName("learn").expand(topic)


def test_the_first_rule_that_fits_renames_a_topic_and_is_undone_for_what_comes_back():
    node = NodeName.remapped("learn", "/", ["joint_states:=/arm/joint_states", "/joint_states:=/other"])
    assert node.resolve("/joint_states") == "/arm/joint_states"
    assert node.original("/arm/joint_states") == "/joint_states"
    assert node.resolve("/tf") == node.original("/tf") == "/tf"


def test_a_node_is_renamed_before_its_topics_are_expanded():
    node = NodeName.remapped("learn", "/", ["~/out:=x", "__node:=pupil", "__ns:=/lab"])
    assert (node.full_name, node.resolve("~/out")) == ("/lab/pupil", "/lab/x")


@pytest.mark.parametrize("rule", ["a", "a:=", ":=b", "a=b", "a b:=c", "a:=b c", "__ns:=lab", "__node:=/x"])
def test_a_rule_of_another_form_is_refused(rule):
    with pytest.raises(WireError, match="expected"):
        NodeName.remapped("learn", "/", [rule])


def test_a_name_that_is_absolute_stays():
    assert check_topic("/hand/left/target") == "/hand/left/target"
