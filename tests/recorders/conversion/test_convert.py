"""Conversion: nothing of a message changes, the same input gives the same file, and bad input is one line."""

import hashlib
from collections import Counter

import bags
import numpy as np
import pytest
import zstandard
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin

from recorders.containers.opening import open_as_it_is, open_log
from recorders.conversion.config import ConvertConfig
from recorders.conversion.convert import convert
from recorders.conversion.sources import Sources
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import PoseStamped, String
from recorders.reading.parts import Parts, find_log
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import SessionReader
from recorders.recovery.log_info import summarise
from recorders.writing.writer import LogWriter

WRITTEN = {
    "cdr": lambda folder: bags.cdr_mcap(folder / "cdr.mcap"),
    "db3": lambda folder: bags.bag_folder(folder / "bag"),
    "ros1": lambda folder: bags.ros1_bag(folder / "log.bag", compression="LZ4"),
    "json": lambda folder: bags.foxglove_json(folder / "json.mcap"),
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    return {name: write(folder) for name, write in WRITTEN.items()}


def as_mcap_reads(path):
    with path.open("rb") as file:
        return [
            (channel.topic, channel.message_encoding, schema.name, schema.encoding, message.data, message.log_time)
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]


def ours(path, out=None, **config):
    """Convert and return what was written."""
    out = out or path.parent / "out.mcap"
    convert([path], out, ConvertConfig(**config), overwrite=True)
    return list(LogReader(out))


def long_log(path, rows):
    with LogWriter(path, manifest={"robot": "asimo"}, attachments={"robot.urdf": b"<robot/>"}) as writer:
        for topic, message, time_ns in rows:
            writer.write(topic, message, log_time_ns=time_ns)
    return path


@pytest.mark.parametrize("name", WRITTEN)
def test_bytes_encodings_and_times_stay_and_the_file_is_sound(written, name, tmp_path):
    out = tmp_path / "out.mcap"
    result = convert([written[name]], out)
    source = open_as_it_is(written[name])
    channels = {channel.topic: channel for channel in source.channels}
    expected = [
        (
            record.topic,
            channels[record.topic].encoding,
            record.type,
            (channels[record.topic].schema or ("", "", b""))[1],
            record.data,
            record.log_time_ns,
        )
        for record in source
    ]
    assert as_mcap_reads(out) == expected
    assert list(LogReader(out)) == list(source)
    assert result.counts == Counter(source.counts)
    summary = summarise(out)
    assert summary.sound
    assert summary.protected
    assert summary.content_holds
    assert {record.topic for record in LogReader(out)} == {bags.JOINTS, bags.POSE, bags.ODOMETRY, bags.TF}
    assert [(record.topic, record.data) for record in open_log(out)] == [
        (record.topic, record.data) for record in open_log(written[name])
    ]


def test_the_same_recordings_give_the_same_file_wherever_they_are(written, tmp_path):
    again = bags.ros1_bag(tmp_path / "log.bag", compression="LZ4")
    for number, source in enumerate((written["ros1"], again, again)):
        convert([source], tmp_path / f"{number}.mcap")
    first, second, third = ((tmp_path / f"{number}.mcap").read_bytes() for number in range(3))
    assert first == second == third


def test_the_manifest_names_the_digest_of_every_file(written, tmp_path):
    convert([written["db3"], written["cdr"]], tmp_path / "out.mcap", ConvertConfig(topics=frozenset([bags.POSE])))
    stated = LogReader(tmp_path / "out.mcap").manifest["converted"]
    files = [written["db3"] / "metadata.yaml", written["db3"] / "bag.db3", written["cdr"]]
    found = [(file["name"], file["sha256"]) for source in stated["sources"] for file in source["files"]]
    assert found == [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
    assert stated["topics"] == [bags.POSE]


def test_several_recordings_are_merged_by_log_time(written, tmp_path):
    names = {bags.JOINTS: "/a/joints", bags.POSE: "/a/pose", bags.TF: "/a/tf", bags.ODOMETRY: "/a/odom"}
    ours(written["db3"], tmp_path / "other.mcap", renames=names)
    convert([tmp_path / "other.mcap", written["ros1"]], tmp_path / "out.mcap")
    found = list(LogReader(tmp_path / "out.mcap"))
    assert len(found) == 2 * 130
    assert [record.log_time_ns for record in found] == sorted(record.log_time_ns for record in found)
    encodings = {channel.topic: channel.encoding for channel in LogReader(tmp_path / "out.mcap").channels}
    assert encodings == dict.fromkeys(names.values(), "cdr") | dict.fromkeys(names, "ros1")


def test_topics_slices_and_names_are_chosen(written, tmp_path):
    whole = list(open_as_it_is(written["cdr"]))
    chosen = ours(written["cdr"], tmp_path / "a.mcap", topics=frozenset(["/t*"]), renames={bags.TF: "/moved"})
    names = {bags.TF: "/moved"}
    expected = [record for record in whole if record.topic in (bags.POSE, bags.TF)]
    assert chosen == [record._replace(topic=names.get(record.topic, record.topic)) for record in expected]
    first_ns = whole[0].log_time_ns
    sliced = ours(written["cdr"], tmp_path / "b.mcap", start_ns=50_000_000, end_ns=100_000_000)
    assert sliced == [r for r in whole if first_ns + 50_000_000 <= r.log_time_ns < first_ns + 100_000_000]


@pytest.mark.parametrize("compression", ["lz4", "zstd", "none"])
def test_chunks_are_compressed_anew(written, tmp_path, compression):
    assert ours(written["cdr"], tmp_path / "out.mcap", compression=compression) == list(LogReader(written["cdr"]))
    assert set(summarise(tmp_path / "out.mcap").survey.chunks) == {"" if compression == "none" else compression}


@pytest.mark.parametrize("limit", [{"split_ns": 100_000_000}, {"split_bytes": 1}])
def test_a_split_is_one_session(tmp_path, limit):
    rows = [("/notes", String("n" * 70_000), step * 10_000_000) for step in range(50)]
    source = long_log(tmp_path / "whole.mcap", rows)
    result = convert([source], tmp_path / "parts.mcap", ConvertConfig(**limit))
    assert len(result.paths) > 2
    assert all(path.is_file() for path in result.paths)
    assert list(open_log(find_log(tmp_path / "parts.mcap"))) == list(LogReader(source))
    if "split_ns" in limit:
        for path in result.paths:
            times = [record.log_time_ns for record in LogReader(path)]
            assert max(times) - min(times) < limit["split_ns"]
    for path in result.paths[1:]:
        path.rename(path.with_name("away"))
        with pytest.raises(LogError, match="missing"):
            find_log(tmp_path / "parts.mcap")
        path.with_name("away").rename(path)
    with pytest.raises(LogError, match="exists"):
        convert([source], tmp_path / "parts.mcap", ConvertConfig(**limit))
    convert([source], tmp_path / "parts.mcap", ConvertConfig(split_ns=300_000_000), overwrite=True)
    assert len(list(tmp_path.glob("parts_*"))) == 2  # none of the former is left
    assert list(open_log(find_log(tmp_path / "parts.mcap"))) == list(LogReader(source))


def test_attachments_metadata_and_manifest_come_along(tmp_path):
    rows = [("/notes", String(str(step)), step) for step in range(3)]
    convert([long_log(tmp_path / "ours.mcap", rows)], tmp_path / "out.mcap")
    reader = LogReader(tmp_path / "out.mcap")
    assert reader.attachments == ("robot.urdf",)
    assert reader.attachment("robot.urdf") == b"<robot/>"
    assert reader.manifest["robot"] == "asimo"
    assert reader.manifest["messages"] == 3
    with (tmp_path / "others.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        writer.add_metadata("place", {"room": "4"})
        writer.add_attachment(5, 6, "notes.txt", "text/plain", b"x" * 20_000_000)
        channel = writer.register_channel("/x", "", 0)
        writer.add_message(channel, 7, b"1", 7, 9)
        writer.finish()
    convert([tmp_path / "others.mcap", tmp_path / "out.mcap"], tmp_path / "both.mcap")
    reader = LogReader(tmp_path / "both.mcap")
    assert dict(reader.metadata)["place"] == {"room": "4"}
    assert reader.attachments == ("notes.txt", "robot.urdf")
    assert reader.attachment("notes.txt") == b"x" * 20_000_000
    assert [record for record in reader if record.topic == "/x"] == list(LogReader(tmp_path / "others.mcap"))
    assert "robot" not in reader.manifest  # not of all recordings


def test_a_log_of_ours_keeps_its_order_unless_it_is_sorted(tmp_path):
    times = [5, 3, 4, 1]
    source = long_log(tmp_path / "ours.mcap", [("/notes", String(str(time)), time) for time in times])
    assert [record.log_time_ns for record in ours(source)] == times
    assert [record.log_time_ns for record in ours(source, sort=True)] == sorted(times)


def test_large_messages_stand_beside_the_chunks(tmp_path):
    path = tmp_path / "large.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/x", "", 0)
        for step, size in enumerate((10, 20_000_000, 30, 17_000_000, 17_000_000, 5)):
            writer.add_message(channel, step, bytes([step]) * size, step, step)
        writer.finish()
    assert ours(path) == list(LogReader(path))
    assert summarise(tmp_path / "out.mcap").sound


def test_a_size_is_looked_at_after_large_messages_too(tmp_path):
    path = tmp_path / "large.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/x", "", 0)
        for step in range(3):
            writer.add_message(channel, step, bytes([step]) * 17_000_000, step, step)
        writer.finish()
    result = convert([path], tmp_path / "out.mcap", ConvertConfig(split_bytes=10_000_000))
    assert [LogReader(part).counts for part in result.paths] == [{"/x": 1}] * 3


@pytest.mark.parametrize("config", [{}, {"split_bytes": 1}, {"topics": frozenset(["/b"])}])
def test_progress_is_the_share_of_the_messages(tmp_path, config):
    rows = [("/b" if step % 2 else "/a", String("n" * 70_000), step) for step in range(120)]
    fractions: list[float] = []
    convert(
        [long_log(tmp_path / "whole.mcap", rows)],
        tmp_path / "out.mcap",
        ConvertConfig(**config),
        on_progress=fractions.append,
    )
    assert len(fractions) > 2
    assert fractions == sorted(set(fractions))
    assert (fractions[0] > 0.0, fractions[-1]) == (True, 1.0)


def test_channels_are_listed_once_however_many_topics_there_are(tmp_path):
    rows = [(f"/{number}", String("x"), number) for number in range(20)]
    source = long_log(tmp_path / "whole.mcap", rows)
    reader, listed = LogReader(source), []

    class Counted(SessionReader):
        @property
        def channels(self):
            listed.append(self)
            return reader.channels

    assert len(Sources([Counted(Parts((source,)))], ConvertConfig()).channels) == 20
    assert len(listed) == 1


def test_an_excerpt_of_an_exploration_is_a_recording(tmp_path):
    source = tmp_path / "ours.mcap"
    with LogWriter(source, manifest={"kind": "exploration", "robot": "asimo"}) as writer:
        for step, topic in enumerate(("/remarks", "/notes")):
            writer.write(topic, String("x"), log_time_ns=step)
    kinds = {
        "exploration": [{}, {"compression": "zstd"}, {"start_ns": 1}],
        "recording": [{"topics": frozenset(["/remarks"])}, {"renames": {"/notes": "/n"}}],
    }
    for kind, configs in kinds.items():
        for config in configs:
            convert([source], tmp_path / "out.mcap", ConvertConfig(**config), overwrite=True)
            manifest = LogReader(tmp_path / "out.mcap").manifest
            assert (manifest["kind"], manifest["robot"]) == (kind, "asimo")


@pytest.mark.parametrize("config", [{}, {"sort": True}, {"start_ns": 1}, {"topics": frozenset(["/x"])}])
@pytest.mark.parametrize("log_times_ns", [[1000, 2000, 3000, 4000], [1000, 3000, 2000, 4000]])
@pytest.mark.parametrize("size", [10, 200_000])
def test_publish_times_stay(tmp_path, config, log_times_ns, size):
    path = tmp_path / "source.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=100 if size == 10 else 2**20)
        writer.start()
        channels = [writer.register_channel(topic, "", 0) for topic in ("/x", "/y")]
        for step, log_time_ns in enumerate(log_times_ns):
            for place, channel in enumerate(channels):
                published_ns = log_time_ns if step == 3 else log_time_ns - 500 + place
                writer.add_message(channel, log_time_ns, bytes(size + step), published_ns, step)
        writer.add_message(channels[0], 5000, bytes(17_000_000 if size > 10 else 1), 4500, 9)
        writer.finish()
    ours(path, tmp_path / "out.mcap", **config)
    times = []
    for log in (path, tmp_path / "out.mcap"):
        with log.open("rb") as file:
            found = NonSeekingReader(file).iter_messages(log_time_order=True)
            times.append([(channel.topic, message.log_time, message.publish_time) for _, channel, message in found])
    start_ns, topics = config.get("start_ns", 0) + 1000, config.get("topics", ("/x", "/y"))
    assert times[1] == [row for row in times[0] if row[1] >= start_ns and row[0] in topics]


@pytest.mark.parametrize("mode", ["file", "message"])
def test_publish_times_of_compressed_bags_stay(tmp_path, mode):
    folder, compress = tmp_path / "bag", zstandard.ZstdCompressor().compress
    folder.mkdir()
    with (folder / "bag.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/x", "", 0)
        writer.add_message(channel, 1000, b"1" if mode == "file" else compress(b"1"), 500)
        writer.finish()
    if mode == "file":
        (folder / "bag.mcap.zstd").write_bytes(compress((folder / "bag.mcap").read_bytes()))
        (folder / "bag.mcap").unlink()
    about = f"storage_identifier: mcap, compression_format: zstd, compression_mode: {mode}"
    name = "bag.mcap.zstd" if mode == "file" else "bag.mcap"
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {{{about}, relative_file_paths: [{name}]}}")
    convert([folder], tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        found = [(message.data, message.publish_time) for _, _, message in make_reader(file).iter_messages()]
    assert found == [(b"1", 500)]


def test_bags_without_definitions_get_those_of_ros(tmp_path):
    source = bags.bag_folder(tmp_path / "bag", count=2) / "bag.db3"
    import sqlite3

    with sqlite3.connect(source) as connection:
        connection.execute("DROP TABLE message_definitions")
    connection.close()
    ours(source, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        schemas = {schema.name: schema.data for schema in make_reader(file).get_summary().schemas.values()}
    assert b"geometry_msgs/Pose pose" in schemas[PoseStamped.TYPE]


def complaint(error, sources, out, **config):
    with pytest.raises(error) as caught:
        convert(sources, out, ConvertConfig(**config))
    assert "\n" not in str(caught.value)
    assert not out.exists() or out in sources
    assert not list(out.parent.glob("*.part"))
    return str(caught.value)


def test_bad_input_is_one_line_and_leaves_no_file(written, tmp_path):
    out = tmp_path / "out.mcap"
    empty = bags.bag_folder(tmp_path / "empty", count=0)
    assert "expected messages in" in complaint(LogError, [empty], out)
    assert "expected messages in the slice" in complaint(LogError, [written["db3"]], out, start_ns=10**12)
    line = complaint(LogError, [written["db3"], written["ros1"]], out)
    assert "expected messages of one type, found sensor_msgs/msg/JointState in cdr and sensor_msgs/" in line
    assert "no topic /nobody" in complaint(LogError, [written["db3"]], out, topics=frozenset(["/nobody"]))
    assert "no topic /nobody" in complaint(ConfigError, [written["db3"]], out, renames={"/nobody": "/x"})
    line = complaint(ConfigError, [written["db3"]], out, renames={bags.POSE: bags.TF})
    assert "each topic under a name of its own" in line
    text = tmp_path / "text.bag"
    text.write_text("not a log")
    assert "text.bag: expected an MCAP file" in complaint(LogError, [text], out)
    missing = bags.bag_folder(tmp_path / "missing", storage=StoragePlugin.MCAP, count=1)
    (missing / "missing.mcap").unlink()
    with pytest.raises(LogError, match=r"missing.mcap missing: expected the file that"):
        find_log(missing)
    source = long_log(tmp_path / "ours.mcap", [("/notes", String("x"), 1)])
    assert "is one of the recordings" in complaint(LogError, [source], source)
    with pytest.raises(ConfigError, match="--compression: expected one of"):
        ConvertConfig(compression="rar")


def test_a_recording_that_is_cut_off_leaves_no_file(tmp_path):
    rows = [("/notes", String("n" * 1000), step) for step in range(3000)]
    source = long_log(tmp_path / "ours.mcap", rows)
    data = source.read_bytes()
    source.write_bytes(data[: len(data) // 2])
    complaint(LogError, [source], tmp_path / "out.mcap")
    complaint(LogError, [source], tmp_path / "out.mcap", split_bytes=1)


def test_a_topic_of_two_types_in_one_recording(tmp_path):
    path = tmp_path / "two.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for step, name in enumerate(("std_msgs/msg/String", "std_msgs/msg/Bool")):
            channel = writer.register_channel("/x", "cdr", writer.register_schema(name, "ros2msg", b"string data"))
            writer.add_message(channel, step, bytes(8), step)
        writer.finish()
    line = complaint(LogError, [path], tmp_path / "out.mcap")
    assert "/x: expected messages of one type, found std_msgs/msg/String in cdr and std_msgs/msg/Bool in cdr" in line


def test_order_of_messages_of_one_time_is_that_of_the_recordings(tmp_path):
    sources = [
        long_log(tmp_path / f"{name}.mcap", [(f"/{name}", PoseStamped(1, np.zeros(3)), 7)] * 3) for name in "abc"
    ]
    convert(sources[::-1], tmp_path / "out.mcap")
    assert [record.topic for record in LogReader(tmp_path / "out.mcap")] == ["/c"] * 3 + ["/b"] * 3 + ["/a"] * 3
