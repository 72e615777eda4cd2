import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from recorders.cdr import templates
from recorders.cdr.codec import decode, decode_as, encode, stamp_ns
from recorders.cdr.rosbags_types import reference_cdr, schema_text, to_rosbags, typestore
from recorders.errors import MessageError
from recorders.messages.message_types import (
    MESSAGE_TYPES,
    Clock,
    Dimension,
    Float64MultiArray,
    JointState,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.messages.validation import MAX_STAMP_NS

text = st.text(st.characters(codec="utf-8"), max_size=12)
stamp = st.integers(0, MAX_STAMP_NS)
floats = st.integers(0, 2**64 - 1)  # any bits: every NaN payload too


def vector(size):
    return st.lists(floats, min_size=size, max_size=size).map(
        lambda bits: np.array(bits, dtype=np.uint64).view(np.float64)
    )


@st.composite
def joint_states(draw):
    names = tuple(draw(st.lists(text, max_size=5)))
    arrays = [draw(vector(draw(st.sampled_from([0, len(names)])))) for _ in range(3)]
    return JointState(draw(stamp), names, arrays[0], velocity=arrays[1], effort=arrays[2], frame_id=draw(text))


transforms = st.builds(TransformStamped, stamp, text, text, vector(3), vector(4))
dimensions = st.builds(Dimension, text, st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
messages = st.one_of(
    joint_states(),
    st.builds(PoseStamped, stamp, vector(3), orientation=vector(4), frame_id=text),
    st.builds(String, text),
    st.builds(Float64MultiArray, st.integers(0, 5).flatmap(vector), dims=st.lists(dimensions, max_size=2)),
    transforms,
    st.builds(TFMessage, st.lists(transforms, max_size=3)),
    st.builds(Clock, stamp),
)


def values(message):
    """Return a message as plain values, floats as their bits, so that NaN equals itself."""
    if isinstance(message, np.ndarray):
        return message.view(np.uint64).tolist()
    if isinstance(message, tuple):
        return [values(item) for item in message]
    if type(message) in MESSAGE_TYPES.values():
        fields = type(message).__dataclass_fields__
        return [type(message), *(values(getattr(message, name)) for name in fields if name not in ("TYPE", "_"))]
    return message


def test_bytes_are_those_of_rosbags(message):
    assert encode(message) == reference_cdr(message)


def test_bytes_are_those_of_mcap_ros2(message):
    serializers = serialize_dynamic(message.TYPE, schema_text(message.TYPE))
    assert encode(message) == bytes(serializers[message.TYPE](plain(to_rosbags(message))))


def test_mcap_ros2_reads_our_bytes(message):
    decoders = generate_dynamic(message.TYPE, schema_text(message.TYPE))
    read = decoders[message.TYPE](encode(message))
    again = serialize_dynamic(message.TYPE, schema_text(message.TYPE))[message.TYPE](read)
    assert bytes(again) == encode(message)


def plain(value):
    """Return an instance of a rosbags class as nested dicts, which mcap_ros2 takes."""
    if hasattr(value, "__dataclass_fields__"):
        names = [name for name in value.__dataclass_fields__ if name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list) else value


def test_round_trip_twice_first_by_the_general_codec_then_by_template(message):
    data = encode(message)
    for _ in range(2):
        assert values(decode(message.TYPE, data)) == values(message)


@settings(max_examples=300)
@given(messages)
def test_any_message_survives_to_the_bit(message):
    data = encode(message)
    assert data == reference_cdr(message)
    assert values(decode(message.TYPE, data)) == values(message)
    assert values(decode(message.TYPE, data)) == values(message)


@settings(max_examples=100)
@given(messages)
def test_big_endian_is_read_too(message):
    data = bytes(typestore().serialize_cdr(to_rosbags(message), message.TYPE, little_endian=False))
    assert data[:2] == b"\x00\x00"
    assert values(decode(message.TYPE, data)) == values(message)
    if isinstance(message, JointState | PoseStamped | TransformStamped):
        assert stamp_ns(message.TYPE, data) == message.stamp_ns


@pytest.mark.parametrize("padding", [1, 2, 3])
def test_trailing_padding_of_other_writers_is_passed_over(message, padding):
    assert values(decode(message.TYPE, encode(message) + bytes(padding))) == values(message)


def test_decoded_arrays_are_read_only_and_aligned():
    data = encode(JointState(1, ("a", "bc"), np.ones(2), velocity=np.ones(2), effort=np.ones(2)))
    for _ in range(2):
        joints = decode_as(JointState, data)
        for array in (joints.position, joints.velocity, joints.effort):
            assert array.flags.aligned
            assert not array.flags.writeable
            assert array.dtype == np.dtype("<f8")


def test_layouts_of_equal_size_are_not_mistaken_for_one_another():
    first, second = (JointState(1, (name,), np.ones(1)) for name in ("ab", "cd"))
    for message in (first, second, first, second):
        assert decode_as(JointState, encode(message)).name == message.name


def test_a_codec_that_disagrees_with_rosbags_is_found_out(monkeypatch):
    monkeypatch.setattr(templates, "reference_cdr", lambda message: b"other")
    with pytest.raises(MessageError, match="our codec and rosbags disagree"):
        encode(PoseStamped(0, np.zeros(3), frame_id="a frame of this test"))


def test_many_layouts_do_not_fill_the_memory():
    for index in range(600):
        message = PoseStamped(0, np.zeros(3), frame_id="x" * index)
        assert decode_as(PoseStamped, encode(message)).frame_id == message.frame_id
    assert len(templates._by_size) <= 256
    assert len(templates._poses) <= 256


def test_the_stamp_is_read_without_decoding(message):
    expected = None if isinstance(message, String | Float64MultiArray | TFMessage | Clock) else message.stamp_ns
    assert stamp_ns(message.TYPE, encode(message)) == expected
    assert stamp_ns("foreign/msg/Type", b"") is None


@pytest.mark.parametrize("kind", MESSAGE_TYPES)
@settings(max_examples=150)
@given(data=st.binary(max_size=120), order=st.sampled_from([b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"]))
def test_hostile_bytes_raise_our_error_only(kind, data, order):
    for read in (decode, stamp_ns):
        try:
            read(kind, order + data)
        except MessageError as error:
            line = str(error)
        else:
            line = ""
        assert "\n" not in line


@settings(max_examples=300)
@given(messages, st.data())
def test_damaged_messages_decode_or_raise_our_error(message, data):
    raw = bytearray(encode(message))
    place = data.draw(st.integers(0, len(raw) - 1))
    raw[place] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(raw)))
    for hostile in (bytes(raw), bytes(raw[:cut])):
        with suppress(MessageError):
            decode(message.TYPE, hostile)


@pytest.mark.parametrize("kind", MESSAGE_TYPES)
def test_a_huge_length_is_refused_before_anything_is_allocated(kind):
    header = b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", 1) + bytes(4)
    for count in (2**32 - 1, 2**31, 2**29):
        for prefix in (header, b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + bytes(4), header + bytes(4)):
            with pytest.raises(MessageError):
                decode(kind, prefix + struct.pack("<I", count) + b"abcd" * 8)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "expected plain CDR"),
        (b"\x00\x01", "expected plain CDR"),
        (b"\x00\x03\x00\x00" + bytes(20), "expected plain CDR"),
        (b"\x00\x01\x00\x00\x05\x00\x00\x00abcd", "cut off"),
        (b"\x00\x01\x00\x00\x02\x00\x00\x00ab", "ends in a zero byte"),
        (b"\x00\x01\x00\x00\x02\x00\x00\x00\xff\x00", "UTF-8"),
        (b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00" + bytes(4), "found 4 more bytes"),
    ],
)
def test_malformed_strings_are_named(data, expected):
    with pytest.raises(MessageError, match=expected):
        decode(String.TYPE, data)


def test_times_out_of_range_are_refused():
    data = bytearray(encode(PoseStamped(1, np.zeros(3))))
    decode(PoseStamped.TYPE, bytes(data))
    for seconds, nanoseconds in ((-1, 0), (0, 10**9)):
        struct.pack_into("<iI", data, 4, seconds, nanoseconds)
        for read in (decode, stamp_ns):
            with pytest.raises(MessageError, match="expected a time from 0 on"):
                read(PoseStamped.TYPE, bytes(data))


def test_unknown_types_are_refused():
    with pytest.raises(MessageError, match="found 'std_msgs/msg/Bool'"):
        decode("std_msgs/msg/Bool", b"\x00\x01\x00\x00\x01")
    with pytest.raises(MessageError, match="found dict"):
        encode({})
    with pytest.raises(MessageError, match="standard ROS 2 type"):
        schema_text("no/msg/Such")


@given(st.lists(text, min_size=1, max_size=5), stamp, st.data())
def test_positions_alone_are_encoded_as_their_message_is(names, stamp_ns, data):
    names, positions = tuple(names), data.draw(vector(len(names)))
    payload = encode(JointState(stamp_ns, names, positions))
    assert templates.PositionEncoder(names).encode(stamp_ns, positions) == payload


frames = st.sampled_from(["world", "earth"])
poses = st.builds(PoseStamped, st.integers(0, 3), vector(3), orientation=vector(4), frame_id=frames)


@given(poses, poses)
def test_a_pair_of_poses_is_read_as_both_are_decoded_or_not_at_all(left, right):
    pair = templates.pose_layout().read_pair(encode(left), encode(right))
    alike = left.stamp_ns == right.stamp_ns and left.frame_id == right.frame_id == "world"
    assert (pair is not None) == alike
    if pair is not None:
        assert pair[0] == left.stamp_ns
        assert [np.array(position).tobytes() for position in pair[1:]] == [p.position.tobytes() for p in (left, right)]


@pytest.mark.parametrize("at", range(4, 12))
def test_a_pair_is_read_if_and_only_if_its_stamp_is_one(at):
    layout, payload = templates.pose_layout(), encode(PoseStamped(10**9 + 7, np.zeros(3)))
    for byte in range(256):
        changed = payload[:at] + bytes([byte]) + payload[at + 1 :]
        expected = None
        with suppress(MessageError):
            expected = decode_as(PoseStamped, changed).stamp_ns
        pair = layout.read_pair(changed, changed)
        assert (None if pair is None else pair[0]) == expected
