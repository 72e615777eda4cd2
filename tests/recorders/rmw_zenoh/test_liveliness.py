"""Tokens and attachments are, byte for byte, what rmw_zenoh and another client of it write."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.errors import MessageError, WireError
from recorders.rmw_zenoh.attachment import Attachment, unpack
from recorders.rmw_zenoh.liveliness import Endpoint, EntityType, Token
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.qos import Durability, History, Qos, Reliability
from recorders.rmw_zenoh.type_hashes import dds_type, type_hash

their_attachment = pytest.importorskip("zenoh_ros2_sdk.attachment")
entity = pytest.importorskip("zenoh_ros2_sdk.entity")
keyexpr = pytest.importorskip("zenoh_ros2_sdk.keyexpr")
their_qos = pytest.importorskip("zenoh_ros2_sdk.qos")

STRING = "std_msgs/msg/String"
# As printed in docs/design.md of ros2/rmw_zenoh, section "Graph Cache", of the talker of its demo.
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
)

names = st.from_regex(r"[a-z][a-z0-9]{0,6}", fullmatch=True)
paths = st.lists(names, min_size=1, max_size=3).map(lambda parts: "/" + "/".join(parts))
profiles = st.builds(
    Qos,
    st.sampled_from([Reliability.RELIABLE, Reliability.BEST_EFFORT]),
    st.sampled_from([Durability.TRANSIENT_LOCAL, Durability.VOLATILE]),
    st.just(History.KEEP_LAST),
    st.integers(1, 1000),
)


def tokens(qos: st.SearchStrategy[Qos] = profiles) -> st.SearchStrategy[Token]:
    endpoints = st.builds(Endpoint, paths, st.just(STRING), st.just(type_hash(STRING)), qos)
    nodes = st.builds(NodeName, names, st.one_of(st.just("/"), paths))
    kinds = st.sampled_from([EntityType.PUBLISHER, EntityType.SUBSCRIPTION])
    return st.builds(Token, st.integers(0, 232), names, st.integers(0, 9), st.integers(0, 9), kinds, nodes, endpoints)


def test_the_token_of_a_talker_is_read():
    token = Token.from_key(TALKER)
    assert (token.domain, token.entity_id, token.entity) == (2, 10, EntityType.PUBLISHER)
    assert token.node.full_name == "/talker"
    assert token.endpoint == Endpoint("/chatter", STRING, type_hash(STRING), Qos(depth=7))
    assert token.to_key() == TALKER


@settings(max_examples=200)
@given(token=tokens())
def test_a_token_is_read_back_by_us_and_by_another_client(token):
    assert Token.from_key(token.to_key()) == token
    theirs = entity.NodeEntity(token.domain, token.session, token.node_id, token.node.name, token.node.namespace)
    end = token.endpoint
    endpoint = entity.EndpointEntity(
        theirs,
        token.entity_id,
        entity.EntityKind(token.entity),
        end.topic,
        dds_type(STRING),
        end.type_hash,
        end.qos.to_token(),
    )
    assert token.to_key() == keyexpr.endpoint_liveliness_keyexpr(endpoint)
    read = their_qos.QosProfile.decode(end.qos.to_token())
    assert (read.reliability.value, read.durability.value, read.history_depth) == (
        end.qos.reliability,
        end.qos.durability,
        end.qos.depth,
    )


@settings(max_examples=100)
@given(namespace=st.one_of(st.just("/"), paths), name=names)
def test_the_token_of_a_node_is_that_of_another_client(namespace, name):
    token = Token(0, "f00", 1, 1, EntityType.NODE, NodeName(name, namespace))
    assert token.to_key() == keyexpr.node_liveliness_keyexpr(entity.NodeEntity(0, "f00", 1, name, namespace))
    assert Token.from_key(token.to_key()) == token


@pytest.mark.parametrize("depth", [1, 10, 42])
def test_quality_of_service_of_another_client_is_read(depth):
    profile = their_qos.QosProfile(history_depth=depth, durability=their_qos.QosDurability.TRANSIENT_LOCAL)
    assert Qos.from_token(profile.encode()) == Qos(durability=Durability.TRANSIENT_LOCAL, depth=depth)


@settings(max_examples=300)
@given(text=st.one_of(st.text(max_size=60), st.text("@ros2_lv/0aMPN%:,", max_size=80)))
def test_any_other_key_is_no_token(text):
    with pytest.raises(WireError, match="expected a liveliness token"):
        Token.from_key(text)


@settings(max_examples=300)
@given(place=st.integers(0, len(TALKER) - 1), character=st.sampled_from("/%:,aZ9 @"))
def test_a_changed_token_is_read_or_refused_and_nothing_else(place, character):
    changed = TALKER[:place] + character + TALKER[place + 1 :]
    try:
        token = Token.from_key(changed)
    except WireError:
        return
    assert isinstance(token, Token)


@settings(max_examples=100)
@given(sequence=st.integers(0, 2**63 - 1), time_ns=st.integers(0, 2**63 - 1), gid=st.binary(min_size=16, max_size=16))
def test_attachments_are_those_of_another_client(sequence, time_ns, gid):
    ours = Attachment(sequence, time_ns, gid)
    assert ours.pack() == their_attachment.Attachment(sequence, time_ns, gid).to_bytes()
    assert unpack(ours.pack() + b"more") == (ours, b"more")


@pytest.mark.parametrize("data", [b"", b"\0" * 32, b"\0" * 33, b"\xff" * 33])
def test_an_attachment_of_another_form_is_refused(data):
    with pytest.raises(MessageError, match="expected"):
        unpack(data)
