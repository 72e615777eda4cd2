"""Every log opens behind `open_log`, and the same session comes out of every container."""

import importlib.util

import bags
import numpy as np
import pytest

from recorders.cdr.codec import decode_as, encode
from recorders.containers.decoding import MessageDecoder
from recorders.containers.definitions import channel_definitions, standard_definitions
from recorders.containers.opening import open_as_it_is, open_log
from recorders.containers.translated import as_poses
from recorders.errors import MessageError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import JointState, PoseStamped, TransformStamped
from recorders.writing.writer import LogWriter

NEEDS_PROTOBUF = pytest.mark.skipif(
    importlib.util.find_spec("mcap_protobuf") is None, reason="needs the extra foxglove"
)
CONTAINERS = [pytest.param(name, marks=NEEDS_PROTOBUF if "protobuf" in name else ()) for name in bags.CONTAINERS]
EXPECTED = [(topic, encode(message), time_ns) for topic, message, time_ns in bags.messages()]


@pytest.fixture(scope="module", params=CONTAINERS)
def named(request, tmp_path_factory):
    return request.param, bags.CONTAINERS[request.param](tmp_path_factory.mktemp("logs"))


def decoded(reader, **options):
    decoder = MessageDecoder(reader.channels)
    return [(record.topic, encode(decoder.decode(record)), record.log_time_ns) for record in reader.records(**options)]


def without_frames(rows):
    """Return the rows with joints that have no frame."""
    found = []
    for topic, data, time_ns in rows:
        if topic == bags.JOINTS:
            joints = decode_as(JointState, data)
            data = encode(JointState(joints.stamp_ns, joints.name, joints.position, velocity=joints.velocity))
        found.append((topic, data, time_ns))
    return found


def test_every_container_yields_the_same_messages_in_order_of_log_time(named):
    name, path = named
    same = without_frames if name.startswith("foxglove") else list
    reader = open_log(path)
    assert decoded(reader) == same(EXPECTED)
    assert sorted(decoded(reader, file_order=True)) == sorted(same(EXPECTED))
    assert reader.counts == {bags.JOINTS: 40, bags.POSE: 40, bags.ODOMETRY: 40, bags.TF: 10}
    assert set(reader.topics) == set(reader.counts)
    # our own types arrive as such, undecoded
    assert reader.topics[bags.JOINTS] == "sensor_msgs/msg/JointState"
    rows = [(record.topic, record.data, record.log_time_ns) for record in reader.records(topics=[bags.JOINTS, bags.TF])]
    assert rows == [row for row in same(EXPECTED) if row[0] in (bags.JOINTS, bags.TF)]


def test_a_slice_is_what_it_is_of_all(named):
    reader = open_log(named[1])
    start_ns, end_ns = bags.START_NS + 55_000_000, bags.START_NS + 201_000_000
    everything = decoded(reader)
    inside = [row for row in everything if start_ns <= row[2] < end_ns]
    assert 0 < len(inside) < len(everything)
    assert decoded(reader, start_ns=start_ns, end_ns=end_ns) == inside
    assert decoded(reader, start_ns=start_ns, end_ns=end_ns, topics=[bags.POSE]) == [
        row for row in inside if row[0] == bags.POSE
    ]


def test_bytes_and_encodings_are_as_recorded_where_they_are_asked_for(named):
    name, path = named
    reader = open_as_it_is(path)
    if name.startswith("ros1") or name.startswith("db3") or "folder" in name:
        stored = [(topic, data, time_ns) for topic, _, data, time_ns in bags.raw(ros=1 if "ros1" in name else 2)]
        assert [(record.topic, record.data, record.log_time_ns) for record in reader] == stored
    encoding = {"ros1": "ros1", "json": "json", "protobuf": "protobuf"}
    expected = next((value for word, value in encoding.items() if word in name), "cdr")
    assert {channel.encoding for channel in reader.channels} == {expected}
    assert all(channel.schema and channel.schema[2] for channel in reader.channels)


def test_a_standard_type_whose_definition_cannot_be_read_is_the_standard_one(tmp_path):
    schema = (JointState.TYPE, "ros2msg", b"x")
    channel = DeclaredChannel("/joints", "cdr", schema=schema)
    own = DeclaredChannel("/own", "cdr", schema=("lab_msgs/msg/Joints", "ros2msg", b"x"))
    joints = JointState(5, ("elbow",), np.array([0.5]))
    with LogWriter(tmp_path / "log.mcap", manifest={}) as writer:
        writer.write("/joints", encode(joints), log_time_ns=1, declared=channel)
    (record,) = open_log(tmp_path / "log.mcap")
    assert (record.type, record.data) == (JointState.TYPE, encode(joints))
    assert channel_definitions(channel) == standard_definitions(2)
    with pytest.raises(MessageError, match="its definition in the log cannot be read as ros2msg"):
        channel_definitions(own)


def test_poses_of_other_types_come_out_as_poses(tmp_path):
    reader = open_log(bags.bag_folder(tmp_path / "bag"))
    decoder = MessageDecoder(reader.channels)
    assert reader.topics[bags.ODOMETRY] == "nav_msgs/msg/Odometry"  # CDR stays what it is
    assert decoder.types[bags.ODOMETRY] == PoseStamped.TYPE


@pytest.mark.parametrize("form", ["db3 folder", "ros1 bag", "foxglove json"])
def test_topics_are_poses_where_poses_are_asked_for(tmp_path, form):
    reader = as_poses(open_log(bags.CONTAINERS[form](tmp_path)), [bags.ODOMETRY, bags.POSE, bags.JOINTS, "/nobody"])
    assert reader.topics[bags.ODOMETRY] == reader.topics[bags.POSE] == PoseStamped.TYPE
    assert reader.topics[bags.JOINTS] == JointState.TYPE
    found = [(record.topic, record.data) for record in reader.records(topics=[bags.POSE, bags.ODOMETRY])]
    assert found == [(topic, data) for topic, data, _ in EXPECTED if topic in (bags.POSE, bags.ODOMETRY)]


def test_a_tracker_of_transforms_is_one_of_poses(tmp_path):
    transform = TransformStamped(7, "odom", "tool", np.array([1.0, 2, 3]), np.array([0, 0, 0.6, 0.8]))
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        log.write("/tracker", transform, log_time_ns=8)
    (record,) = as_poses(open_log(tmp_path / "log.mcap"), ["/tracker"])
    pose = decode_as(PoseStamped, record.data)
    assert record.type == PoseStamped.TYPE
    assert (pose.stamp_ns, pose.frame_id) == (7, "odom")
    assert pose.position.tolist() + pose.orientation.tolist() == [1, 2, 3, 0, 0, 0.6, 0.8]


@pytest.mark.parametrize(
    "form", ["foxglove json", pytest.param("foxglove protobuf", marks=NEEDS_PROTOBUF), "ros1 mcap"]
)
def test_a_malformed_message_ends_nothing_and_is_no_message_of_its_type(tmp_path, form):
    source = open_as_it_is(bags.CONTAINERS[form](tmp_path))
    channels = {channel.topic: channel for channel in source.channels}
    channel = channels[bags.POSE]
    assert channel.schema is not None
    _, kind, text = channel.schema
    cdr = encode(PoseStamped(1, np.zeros(3)))
    datas = [record.data for record in source.records(topics=[bags.POSE])][:3]
    malformed = [datas[0], b"\xff\xff", datas[1], datas[1][:-1], cdr, datas[2]]
    rows = [
        (bags.POSE, channel.encoding, channel.type, (kind, text), data, step) for step, data in enumerate(malformed)
    ]
    found = list(open_log(bags.mcap_file(tmp_path / "odd.mcap", rows)))
    assert [record.log_time_ns for record in found] == list(range(6))
    assert {record.type for record in found} == {PoseStamped.TYPE}
    assert [found[1].data, found[3].data, found[4].data] == [b"\xff\xff", datas[1][:-1], b""]
    for step, record in enumerate(found):
        if step in (1, 3, 4):
            with pytest.raises(MessageError):
                decode_as(PoseStamped, record.data)
        else:
            decode_as(PoseStamped, record.data)
