"""The fast way from ROS 1 to CDR gives the bytes of the general one, or nothing."""

import bags
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recorders.cdr.codec import encode
from recorders.containers.decoding import find_decoding
from recorders.containers.ros1_to_cdr import transcoder
from recorders.errors import MessageError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.validation import MAX_STAMP_NS

TEXTS = st.text(max_size=9)
STAMPS = st.integers(0, MAX_STAMP_NS)
FLOATS = st.floats(width=64)


@st.composite
def joints(draw):
    names = tuple(draw(st.lists(TEXTS, max_size=5)))
    columns = [draw(arrays(float, draw(st.sampled_from([0, len(names)])), elements=FLOATS)) for _ in range(3)]
    frame = draw(TEXTS)
    return JointState(draw(STAMPS), names, columns[0], velocity=columns[1], effort=columns[2], frame_id=frame)


POSES = st.builds(
    PoseStamped,
    STAMPS,
    arrays(float, 3, elements=FLOATS),
    orientation=arrays(float, 4, elements=FLOATS),
    frame_id=TEXTS,
)


def there(found):
    assert found is not None
    return found


def channel(kind: str) -> DeclaredChannel:
    text, _ = bags.ROS1.generate_msgdef(kind)
    return DeclaredChannel("/x", "ros1", schema=(kind.replace("/msg/", "/"), "ros1msg", text.encode()))


@given(messages=st.lists(st.one_of(joints(), POSES), min_size=1, max_size=4), cut=st.integers(0, 40))
def test_it_is_the_general_way(messages, cut):
    ways = {}
    for message in messages:
        kind, value = bags.ros_value(bags.ROS1, "/x", message)
        data = bytes(bags.ROS1.serialize_ros1(value, kind))
        if kind not in ways:
            ways[kind] = there(transcoder(channel(kind))), there(find_decoding(channel(kind)))
        fast, general = ways[kind]
        assert fast(data) == encode(general.decode(data)) == encode(message)
        if cut:
            assert fast(data[:-cut]) is None
            with pytest.raises(MessageError):
                general.decode(data[:-cut])
        assert fast(data + b"\0") is None


@pytest.mark.parametrize("stamp", [b"\xff" * 8, b"\0\0\0\x80" + bytes(4), bytes(4) + b"\0\xca\x9a\x3b"])
def test_stamps_that_ros_2_has_not_are_left_to_the_general_way(stamp):
    kind, value = bags.ros_value(bags.ROS1, "/x", PoseStamped(0, np.zeros(3)))
    data = bytes(bags.ROS1.serialize_ros1(value, kind))
    assert there(transcoder(channel(kind)))(data[:4] + stamp + data[12:]) is None


def test_another_definition_is_not_taken_for_the_usual_one():
    usual = channel(PoseStamped.TYPE)
    name, encoding, text = there(usual.schema)
    other = DeclaredChannel("/x", "ros1", schema=(name, encoding, text.replace(b"Pose pose", b"Pose pose\nbool ok", 1)))
    assert transcoder(usual) is not None
    assert transcoder(other) is None
