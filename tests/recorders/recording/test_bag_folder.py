"""A recording's folder is a bag: rosbags, which reads what rosbag2 writes, finds every topic, number and byte in it."""

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.opening import open_log
from recorders.errors import LogError, TakenError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import PoseStamped, String
from recorders.messages.topics import LEFT_TARGET
from recorders.reading.reader import LogReader
from recorders.recording.bag_folder import new_bag_folder, write_bag_metadata
from recorders.rmw_zenoh.bag_channels import bag_channel, with_schema
from recorders.rmw_zenoh.qos import Durability, Qos, Reliability
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.writing.writer import LogWriter

START_NS = 1_700_000_000_000_000_000


def write(path: Path, first: int, count: int = 5) -> Path:
    with LogWriter(path, manifest={}) as writer:
        for index in range(first, first + count):
            pose = PoseStamped(index * 1000, [0.1 * index, 0.2, 0.3])
            writer.write(LEFT_TARGET, pose, log_time_ns=START_NS + index * 1000)
    return path


def test_another_reader_finds_every_message_of_all_parts(tmp_path):
    parts = [write(tmp_path / f"run_{number:03}.mcap", 5 * number) for number in range(3)]
    write_bag_metadata(parts)
    with AnyReader([tmp_path]) as reader:
        assert [(c.topic, c.msgtype) for c in reader.connections] == [(LEFT_TARGET, PoseStamped.TYPE)]
        found = [(time_ns, bytes(data)) for _, time_ns, data in reader.messages()]
        assert (reader.start_time, reader.message_count) == (START_NS, 15)
    assert found == [(record.log_time_ns, record.data) for record in open_log(tmp_path)]


def test_hash_and_quality_of_service_of_a_topic_are_kept(tmp_path):
    offered = [Qos(Reliability.BEST_EFFORT, Durability.TRANSIENT_LOCAL, depth=3), Qos()]
    channel = bag_channel("/chatter", String.TYPE, type_hash(String.TYPE), offered)
    with LogWriter(tmp_path / "run.mcap", manifest={}) as writer:
        writer.write("/chatter", encode(String("a")), log_time_ns=START_NS, declared=channel)
    write_bag_metadata([tmp_path / "run.mcap"])
    with Reader(tmp_path) as reader:
        (connection,) = reader.connections
        profiles = connection.ext.offered_qos_profiles
        assert [bytes(data) for _, _, data in reader.messages()] == [encode(String("a"))]
    assert connection.digest == type_hash(String.TYPE)
    assert connection.msgdef.data == schema_text(String.TYPE)
    assert [(found.depth, found.reliability.value, found.durability.value) for found in profiles] == [
        (each.depth, each.reliability, each.durability) for each in offered
    ]


def test_the_metadata_are_those_of_a_version_of_rosbag2(tmp_path):
    """Keys as `rosbag2_storage/yaml.hpp` of ros2/rosbag2 reads them of version 7, which it wrote as of Iron."""
    write_bag_metadata([write(tmp_path / "run.mcap", 0)])
    (about,) = YAML(typ="safe").load((tmp_path / "metadata.yaml").read_text()).values()
    assert set(about) == {
        "version",
        "storage_identifier",
        "duration",
        "starting_time",
        "message_count",
        "topics_with_message_count",
        "compression_format",
        "compression_mode",
        "relative_file_paths",
        "files",
        "custom_data",
    }
    assert (about["version"], about["custom_data"]) == (7, {})
    (topic,) = about["topics_with_message_count"]
    assert set(topic) == {"topic_metadata", "message_count"}
    assert set(topic["topic_metadata"]) == {
        "name",
        "type",
        "serialization_format",
        "offered_qos_profiles",
        "type_description_hash",
    }
    assert all(isinstance(value, str) for value in topic["topic_metadata"].values())


def test_every_channel_of_a_bag_has_a_schema(tmp_path):
    """rosbag2's reader of MCAP throws at one that has none, whatever is to be played (`MCAPStorage::get_metadata`)."""
    other = DeclaredChannel("/blob", "raw", (("made", "elsewhere"),))
    channels = {"/pose": None, "/noise": with_schema("/noise", "", None), "/blob": with_schema("/blob", "raw", other)}
    assert with_schema("/pose", PoseStamped.TYPE, None) is None
    with LogWriter(tmp_path / "run.mcap", manifest={}) as writer:
        writer.write("/pose", PoseStamped(0, [0.1, 0.2, 0.3]), log_time_ns=START_NS)
        for topic in ("/noise", "/blob"):
            writer.write(topic, b"?", log_time_ns=START_NS + 1, opaque=True, declared=channels[topic])
    write_bag_metadata([tmp_path / "run.mcap"])
    stored = LogReader(tmp_path / "run.mcap").channels
    assert [(each.topic, each.encoding, each.type) for each in stored] == [
        ("/pose", "cdr", PoseStamped.TYPE),
        ("/noise", "application/octet-stream", "unknown"),
        ("/blob", "raw", "unknown"),
    ]
    assert dict(stored[2].metadata)["made"] == "elsewhere"
    with AnyReader([tmp_path]) as reader:
        assert [connection.topic for connection, _, _ in reader.messages()] == ["/pose"]


def test_a_recording_without_a_message_is_a_bag_too(tmp_path):
    with LogWriter(tmp_path / "run.mcap", manifest={}):
        pass
    write_bag_metadata([tmp_path / "run.mcap"])
    with Reader(tmp_path) as reader:
        assert (reader.message_count, reader.connections) == (0, [])


def test_only_a_new_or_empty_folder_is_taken(tmp_path):
    assert new_bag_folder(tmp_path / "a" / "run") == tmp_path / "a" / "run" / "run.mcap"
    assert new_bag_folder(tmp_path / "a" / "run").parent.is_dir()
    with pytest.raises(TakenError, match=r"found run in it"):
        new_bag_folder(tmp_path / "a")
    (tmp_path / "file").touch()
    with pytest.raises(TakenError, match="found a file"):
        new_bag_folder(tmp_path / "file")


def test_a_damaged_file_is_no_part_of_a_bag(tmp_path):
    path = write(tmp_path / "run.mcap", 0)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(LogError, match=r"run\.mcap"):
        write_bag_metadata([path])
