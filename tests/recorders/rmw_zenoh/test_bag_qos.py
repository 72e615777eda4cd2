"""Quality of service goes into bags and comes back as rosbags, which reads what rosbag2 writes, has it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Qos as TheirQos
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from ruamel.yaml import YAML

from recorders.errors import WireError
from recorders.messages.message_types import String
from recorders.rmw_zenoh.bag_channels import QOS_METADATA, bag_channel, schema_of_type, stated_qos
from recorders.rmw_zenoh.qos import (
    LATCHED,
    MAX_DEPTH,
    Durability,
    History,
    Liveliness,
    Qos,
    Reliability,
    qos_text,
    read_qos_text,
    strictest,
)
from recorders.rmw_zenoh.type_hashes import UNKNOWN_HASH, type_hash
from recorders.text.plain_yaml import to_yaml

times = st.tuples(st.integers(0, 2**31), st.integers(0, 10**9 - 1))
profiles = st.builds(
    Qos,
    st.sampled_from([Reliability.RELIABLE, Reliability.BEST_EFFORT]),
    st.sampled_from([Durability.TRANSIENT_LOCAL, Durability.VOLATILE]),
    st.sampled_from([History.KEEP_LAST, History.KEEP_ALL]),
    st.integers(1, MAX_DEPTH),
    times,
    times,
    st.sampled_from([Liveliness.AUTOMATIC, Liveliness.MANUAL_BY_TOPIC]),
    times,
)
CASES = [
    (History.KEEP_ALL, 0),
    (History.KEEP_ALL, 7),
    (History.KEEP_LAST, 0),
    (History.KEEP_LAST, 7),
    (History.KEEP_LAST, MAX_DEPTH + 1),
]
several = st.lists(profiles, min_size=1, max_size=3)


def values(qos: TheirQos) -> dict[str, object]:
    """Return a profile of rosbags as its own version 8 has it."""
    names = ("history", "depth", "reliability", "durability", "deadline", "lifespan", "liveliness")
    found = {name: getattr(qos, name) for name in (*names, "liveliness_lease_duration")}
    return {
        name: value._asdict() if hasattr(value, "_asdict") else getattr(value, "value", value)
        for name, value in found.items()
    } | {"avoid_ros_namespace_conventions": qos.avoid_ros_namespace_conventions}


@settings(max_examples=20)
@given(offered=several)
def test_profiles_are_read_back_by_us_and_by_rosbags(offered: list[Qos]) -> None:
    text = qos_text(offered)
    assert read_qos_text(text) == offered
    theirs = parse_qos(text)
    assert [values(each) for each in theirs] == [each.to_rosbag2() for each in offered]
    assert read_qos_text(to_yaml(dump_qos_v9(theirs))) == offered  # by the policies' names, as since Jazzy


@settings(max_examples=20)
@given(offered=several, requested=profiles)
def test_one_publisher_in_place_of_several_matches_what_any_of_them_matched(offered: list[Qos], requested: Qos) -> None:
    """By the table of compatible profiles in ROS 2's documentation of quality of service."""

    def matches(offer: Qos) -> bool:
        return (
            not (offer.reliability is Reliability.BEST_EFFORT and requested.reliability is Reliability.RELIABLE)
            and not (not offer.is_latched and requested.is_latched)
            and offer.deadline <= requested.deadline
            and offer.liveliness >= requested.liveliness
            and offer.lease <= requested.lease
        )

    one = strictest(offered)
    assert matches(one) or not any(map(matches, offered))
    assert one.depth == min(MAX_DEPTH, sum(each.depth for each in offered))
    assert strictest(offered[:1]) == offered[0]


@pytest.mark.parametrize(
    "text",
    [
        "history",
        "- 3",
        "- {history: 1}",
        "[[[[[[[[[[[[",
        "&a [*a]",
        "\t- :",
        qos_text([Qos()]).replace("depth: 10", "depth: -1"),
        qos_text([Qos()]).replace("history: 1", "history: 7"),
        qos_text([Qos()]).replace("history: 1", "history: first"),
        qos_text([Qos()]).replace("depth: 10", "depth: [1, 2]"),
    ],
)
def test_what_is_no_list_of_profiles_is_refused(text: str) -> None:
    with pytest.raises(WireError, match="quality of service: expected"):
        read_qos_text(text)


def test_a_depth_that_rosbag2_cannot_read_is_the_largest_that_it_can() -> None:
    found = read_qos_text(qos_text([Qos(depth=2**64 - 1), Qos(depth=2**31 - 1)]))
    assert found == 2 * [Qos(depth=2**31 - 1)]


def test_times_without_end_of_old_bags_have_none() -> None:
    endless = YAML(typ="safe").load(qos_text([Qos()]))
    endless[0]["deadline"] = {"sec": 2147483647, "nsec": 4294967295}
    assert read_qos_text(to_yaml(endless)) == [Qos()]
    assert read_qos_text("") == []


def test_a_topic_is_played_as_it_was_offered_and_else_as_ros_has_it() -> None:
    once, twice = Qos(Reliability.BEST_EFFORT, depth=2), Qos(depth=3)
    recorded = bag_channel("/chatter", String.TYPE, UNKNOWN_HASH, [once, twice])
    assert stated_qos([recorded], "/chatter") == Qos(depth=5)
    assert stated_qos([recorded], "/robot_description") == LATCHED
    unstated = bag_channel("/chatter", String.TYPE, UNKNOWN_HASH, [])
    assert dict(unstated.metadata)[QOS_METADATA] == ""
    assert stated_qos([unstated], "/chatter") == Qos()


def test_a_latched_topic_keeps_something_whatever_depth_a_bag_states() -> None:
    found = [
        Qos(durability=Durability.TRANSIENT_LOCAL, history=history, depth=depth).cache_depth for history, depth in CASES
    ]
    assert found == [MAX_DEPTH, MAX_DEPTH, 1, 7, MAX_DEPTH]


def test_a_type_of_another_definition_has_none_in_the_bag() -> None:
    assert schema_of_type(String.TYPE, type_hash(String.TYPE))[2].startswith(b"string data")
    assert schema_of_type(String.TYPE, "")[2].startswith(b"string data")
    assert schema_of_type(String.TYPE, "RIHS01_" + 64 * "0") == (String.TYPE, "", b"")
    assert schema_of_type("lab/msg/Grip", "") == ("lab/msg/Grip", "", b"")
