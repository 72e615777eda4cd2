"""Types have the names and hashes that ROS 2 itself computes."""

import pytest
from rosbags.typesys import Stores, get_typestore

from recorders.cdr.rosbags_types import typestore
from recorders.errors import MessageError
from recorders.messages.message_types import MESSAGE_TYPES
from recorders.rmw_zenoh.keys import TopicKey
from recorders.rmw_zenoh.type_hashes import dds_type, ros_type, type_hash

others = pytest.importorskip("zenoh_ros2_sdk.utils")
ros2 = pytest.importorskip("pamoja.ros2")

PUBLISHED = {
    # The first as printed in docs/design.md of ros2/rmw_zenoh, the second as `ros2 topic info -v` prints it in Jazzy.
    "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "sensor_msgs/msg/JointState": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}


@pytest.mark.parametrize(("name", "expected"), PUBLISHED.items())
def test_hashes_are_those_that_ros_prints(name, expected):
    assert type_hash(name) == expected


def definition(name: str) -> str:
    return typestore().generate_msgdef(name, ros_version=2)[0].partition("=" * 80)[0]


def parts(name: str) -> dict[str, str]:
    """Return the definitions of all types that one contains, however deep."""
    texts = typestore().generate_msgdef(name, ros_version=2)[0].split("=" * 80 + "\n")[1:]
    named = (text.partition("\n") for text in texts)
    return {head.removeprefix("MSG: ").replace("/", "/msg/"): body for head, _, body in named}


@pytest.mark.parametrize("name", sorted(MESSAGE_TYPES))
def test_hashes_of_all_our_types_are_those_of_another_client(name):
    assert type_hash(name) == others.get_type_hash(name, definition(name), parts(name))


@pytest.mark.parametrize("name", sorted(MESSAGE_TYPES))
def test_keys_of_all_our_types_are_those_of_a_second_client_which_reads_their_hashes(name):
    """It has no definitions, and computes no hash: it reads one, as it stands in keys."""
    assert dds_type(name) == ros2.dds_type_name(name)
    assert ros2.type_hash_digest(type_hash(name)) == bytes.fromhex(type_hash(name).removeprefix("RIHS01_"))
    assert TopicKey(0, "/a/b", name, type_hash(name)).to_text() == ros2.entity_key(0, "/a/b", name, type_hash(name))


@pytest.mark.parametrize("name", sorted(MESSAGE_TYPES))
def test_hashes_are_the_same_in_a_later_distribution(name):
    assert type_hash(name) == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(name)


@pytest.mark.parametrize("name", sorted(MESSAGE_TYPES))
def test_a_dds_name_is_read_back(name):
    assert ros_type(dds_type(name)) == name


@pytest.mark.parametrize("name", ["String", "std_msgs/String", "std_msgs::msg::String", "a/msg/b c", ""])
def test_what_is_no_type_is_refused(name):
    with pytest.raises(MessageError, match="expected a ROS 2 type"):
        dds_type(name)
    with pytest.raises(MessageError, match="expected a DDS type"):
        ros_type(name)


def test_a_type_that_ros_does_not_have_is_refused():
    with pytest.raises(MessageError, match="expected a standard ROS 2 type"):
        type_hash("lab_msgs/msg/Gripper")
