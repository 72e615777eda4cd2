import os
from contextlib import suppress

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Attachment, Metadata
from mcap.stream_reader import StreamReader

from recorders.cdr.codec import encode
from recorders.errors import LogError, MessageError
from recorders.mcap_format.manifest import METADATA_NAME, content_sha256, from_metadata
from recorders.mcap_format.records import MAGIC
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.topics import LEFT_TARGET, ROBOT_DESCRIPTION, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.chunk_writer import FLUSH_EVERY
from recorders.writing.writer import MAX_CHANNELS, LogWriter


def target(stamp_ns=0):
    return PoseStamped(stamp_ns, np.array([0.3, 0.2, 0.7]))


def test_two_identical_recordings_give_identical_files(write_log):
    assert write_log(30, "a.mcap").read_bytes() == write_log(30, "b.mcap").read_bytes()


def test_the_manifest_says_what_made_the_log(log):
    reader = LogReader(log)
    manifest = reader.manifest
    assert manifest["robot"] == "asimo"
    assert manifest["seed"] == 3
    assert manifest["format_version"] == 2
    assert manifest["complete"] is True
    assert manifest["messages"] == 280 == sum(reader.counts.values())
    assert manifest["counts"] == reader.counts
    assert manifest["content_sha256"] == content_sha256(reader)
    assert "numpy" in manifest["environment"]["packages"]


def test_messages_are_numbered_from_zero_by_topic(log):
    seen: dict[str, int] = {}
    for record in LogReader(log):
        assert record.sequence == seen.get(record.topic, -1) + 1
        seen[record.topic] = record.sequence
    assert set(seen.values()) == {39}


def test_a_producers_own_numbers_are_kept_and_told_apart(tmp_path):
    path = tmp_path / "log.mcap"
    with LogWriter(path, manifest={}) as log:
        log.write(SESSION_PHASE, String("a"), log_time_ns=0)
        log.write(LEFT_TARGET, target(), log_time_ns=0, sequence=17)
        log.write(LEFT_TARGET, target(1), log_time_ns=1, sequence=19)
        log.write(LEFT_TARGET, target(2), log_time_ns=2)
    assert [record.sequence for record in LogReader(path).records(topics=[LEFT_TARGET])] == [17, 19, 0]
    with path.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    found = [(channel.topic, channel.metadata) for channel in channels]
    assert found == [
        (SESSION_PHASE, {"sequence": "writer"}),
        (LEFT_TARGET, {"sequence": "producer"}),
        (LEFT_TARGET, {"sequence": "writer"}),
    ]


def test_bytes_and_copied_records_are_written_as_they_are(tmp_path, log):
    copy = tmp_path / "copy.mcap"
    with LogWriter(copy, manifest={}) as writer:
        for record in LogReader(log):
            writer.copy(record)
    assert list(LogReader(copy)) == list(LogReader(log))
    foreign = tmp_path / "foreign.mcap"
    with LogWriter(foreign, manifest={}) as writer:
        writer.write("/flag", b"\x00\x01\x00\x00\x01", log_time_ns=5, type_name="std_msgs/msg/Bool")
        writer.write(LEFT_TARGET, encode(target()), log_time_ns=6)
    assert [record.type for record in LogReader(foreign)] == ["std_msgs/msg/Bool", PoseStamped.TYPE]


def test_the_log_is_standard_ros2_mcap_with_every_crc(log):
    with log.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        assert reader.get_header().library == "reenact"
        summary = reader.get_summary()
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {index.compression for index in summary.chunk_indexes} == {"lz4"}
        assert len(summary.chunk_indexes) == 280 // FLUSH_EVERY + 1
        assert len(list(reader.iter_messages())) == 280
        (attachment,) = reader.iter_attachments()
    assert (attachment.name, attachment.create_time, attachment.log_time) == ("robot.urdf", 0, 0)
    raw = log.read_bytes()
    assert raw[-12:-8] != bytes(4)  # the summary's CRC, before the closing magic


def test_a_log_is_not_overwritten_unless_told(tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(MAGIC + b"precious")
    with pytest.raises(LogError, match=r"log.mcap exists: choose another name"):
        LogWriter(path, manifest={})
    assert path.read_bytes() == MAGIC + b"precious"
    with LogWriter(path, manifest={}, overwrite=True) as log:
        log.write(LEFT_TARGET, target(), log_time_ns=0)
    assert len(list(LogReader(path))) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["log.mcap"]


@pytest.mark.parametrize("content", [b"precious", b"PK\x03\x04", MAGIC[:-1]])
def test_what_is_no_log_is_never_replaced(tmp_path, content):
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"log.mcap: there is a file that is no log, which stays as it is; choose"):
        LogWriter(path, manifest={}, overwrite=True)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("log.mcap", content)]


def test_an_empty_file_may_be_replaced(tmp_path):
    path = tmp_path / "log.mcap"
    path.touch()
    LogWriter(path, manifest={}, overwrite=True).close()
    assert list(LogReader(path)) == []


def test_after_an_exception_the_part_is_readable_and_says_so(tmp_path):
    path = tmp_path / "log.mcap"

    def record():
        with LogWriter(path, manifest={"seed": 1}) as log:
            for tick in range(100):
                log.write(LEFT_TARGET, target(tick), log_time_ns=tick)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record()
    assert not path.exists()
    reader = LogReader(tmp_path / "log.mcap.part")
    assert reader.manifest["complete"] is False
    assert reader.manifest["content_sha256"] == content_sha256(reader)
    assert len(list(reader)) == 100


def test_an_aborted_recording_without_messages_leaves_nothing(tmp_path):
    def record():
        with LogWriter(tmp_path / "log.mcap", manifest={}):
            raise RuntimeError("no robot")

    with pytest.raises(RuntimeError, match="no robot"):
        record()
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_is_readable_before_the_end(tmp_path):
    path = tmp_path / "log.mcap"
    with LogWriter(path, manifest={}) as log:
        for tick in range(2 * 64):
            log.write(LEFT_TARGET, target(tick), log_time_ns=tick)
        with log.part.open("rb") as file:
            found = len(list(_until_the_end(NonSeekingReader(file))))
        assert found == 2 * 64  # a crash loses fewer than 64 messages


def _until_the_end(reader):
    messages = reader.iter_messages(log_time_order=False)
    while True:
        try:
            yield next(messages)
        except Exception:
            return


@pytest.mark.parametrize(
    ("topic", "message", "options", "expected"),
    [
        (LEFT_TARGET, String("x"), {}, "/hand/left/target: expected geometry_msgs/msg/PoseStamped, found std_msgs"),
        (LEFT_TARGET, b"x", {"type_name": "std_msgs/msg/String"}, "expected geometry_msgs/msg/PoseStamped"),
        ("/camera", b"x", {}, "expected a standard ROS 2 type such as .*, found ''"),
        (LEFT_TARGET, target(), {"sequence": -1}, "out of range"),
        (LEFT_TARGET, target(), {"sequence": 2**32}, "out of range"),
        (LEFT_TARGET, target(), {"log_time_ns": 2**64}, "out of range"),
        (LEFT_TARGET, target(), {"log_time_ns": -1}, "out of range"),
        (LEFT_TARGET, target(), {"publish_time_ns": 2**64}, "out of range"),
        (LEFT_TARGET, "text", {}, "expected a message"),
    ],
)
def test_wrong_messages_are_refused_and_the_log_goes_on(tmp_path, topic, message, options, expected):
    path = tmp_path / "log.mcap"
    with LogWriter(path, manifest={}) as log:
        with pytest.raises(MessageError, match=expected):
            log.write(topic, message, **{"log_time_ns": 0, **options})
        log.write(ROBOT_DESCRIPTION, String("<robot/>"), log_time_ns=0)
    assert [record.topic for record in LogReader(path)] == [ROBOT_DESCRIPTION]


def test_a_manifest_that_cannot_be_written_is_refused_before_recording(tmp_path):
    with pytest.raises(LogError, match="manifest: rate cannot be written"):
        LogWriter(tmp_path / "a.mcap", manifest={"rate": float("nan")})
    with pytest.raises(LogError, match="complete is set by the writer"):
        LogWriter(tmp_path / "a.mcap", manifest={"complete": True})
    assert list(tmp_path.iterdir()) == []
    with LogWriter(tmp_path / "a.mcap", manifest={"seed": 3}) as log:
        with pytest.raises(LogError, match="manifest: rate cannot be written"):
            log.note({"rate": float("nan")})
        log.note({"rate": 1.0})
    manifest = LogReader(log.path).manifest
    assert (manifest["seed"], manifest["rate"], manifest["complete"]) == (3, 1.0, True)


def test_a_directory_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(LogError, match=r"cannot write .*none/log.mcap: expected a folder .*none, found none"):
        LogWriter(tmp_path / "none" / "log.mcap", manifest={})


@pytest.mark.parametrize("overwrite", [False, True])
def test_what_is_no_file_is_refused_at_once(tmp_path, overwrite):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "dangling").symlink_to(tmp_path / "none")
    for path in (".", "..", "/", "", tmp_path / "folder", tmp_path / "pipe", tmp_path / "dangling"):
        with pytest.raises(LogError, match=r"cannot write .*: expected the name of a file, found something else"):
            LogWriter(path, manifest={}, overwrite=overwrite)
    for path in (f"{tmp_path}/nul\0", tmp_path / ("x" * 300)):
        with pytest.raises(LogError, match="cannot write"):
            LogWriter(path, manifest={}, overwrite=overwrite)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["dangling", "folder", "pipe"]


def test_the_log_begins_with_its_manifest(tmp_path):
    with LogWriter(tmp_path / "log.mcap", manifest={"seed": 3}, attachments={"a.toml": b"a"}) as log:
        assert _manifests(log.part) == [{**_known(log.part), "seed": 3, "complete": False}]
        log.note({"run": "a"})
        log.write(LEFT_TARGET, target(), log_time_ns=0)
        assert _manifests(log.part)[1:] == [{**_known(log.part), "seed": 3, "run": "a", "complete": False}]
        log.note({"robot": "asimo"})
        assert _manifests(log.part)[2:] == [
            {**_known(log.part), "seed": 3, "run": "a", "robot": "asimo", "complete": False}
        ]
    outcome = {"messages": 1, "counts": {LEFT_TARGET: 1}, "content_sha256": content_sha256(LogReader(log.path))}
    *_, last = _manifests(log.path)
    assert last == {**_known(log.path), "seed": 3, "run": "a", "robot": "asimo", "complete": True, **outcome}
    assert LogReader(log.path).manifest == last


def _manifests(path):
    """Return the manifests in the part of a file that is there."""
    found = [record for record in _records(path) if isinstance(record, Metadata) and record.name == METADATA_NAME]
    return [from_metadata(record.metadata) for record in found]


def _records(path):
    """Yield the records in the part of a file that is there."""
    with path.open("rb") as file, suppress(EndOfFile):
        yield from StreamReader(file).records


def _known(path):
    return {key: _manifests(path)[0][key] for key in ("format_version", "environment")}


def test_a_disk_that_fills_up_keeps_what_was_written(tmp_path, monkeypatch):
    resource = pytest.importorskip("resource")
    signal = pytest.importorskip("signal")
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    rng = np.random.default_rng(0)

    def record():
        with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
            for tick in range(10_000):
                log.write(LEFT_TARGET, PoseStamped(tick, rng.random(3)), log_time_ns=tick)

    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))
        with pytest.raises(LogError, match=r"cannot write .*: File too large"):
            record()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, old)
    records = []
    with pytest.raises(LogError, match="cut off"):  # noqa: PT012  one by one: the last step raises
        for found in LogReader(tmp_path / "log.mcap.part"):
            records.append(found)
    assert len(records) > 500
    assert [found.sequence for found in records] == list(range(len(records)))


def test_writing_to_a_closed_log_is_refused(tmp_path):
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    log.close()
    log.close()
    for act in (lambda: log.write(SESSION_PHASE, String("x"), log_time_ns=0), log.flush):
        with pytest.raises(LogError, match="the log was closed"):
            act()
    assert list(LogReader(tmp_path / "log.mcap")) == []


def test_joint_states_survive_to_the_bit(tmp_path):
    path = tmp_path / "log.mcap"
    message = JointState(3, ("a", "b"), np.array([-0.0, 5e-324]), velocity=np.array([0.1, np.pi]))
    with LogWriter(path, manifest={}) as log:
        log.write("/joint_states", message, log_time_ns=3)
    (record,) = LogReader(path)
    assert record.data == encode(message)


def test_the_largest_numbers_and_attachments_of_later_are_there(tmp_path):
    most = 2**64 - 1
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        log.write(LEFT_TARGET, target(), log_time_ns=most, publish_time_ns=most, sequence=2**32 - 1)
        log.attach("late.toml", b"late")
        found = [record for record in _records(log.part) if isinstance(record, Attachment)]
        assert [(record.name, record.media_type, record.data) for record in found] == [
            ("late.toml", "application/toml", b"late")
        ]
    (record,) = LogReader(log.path)
    assert (record.log_time_ns, record.sequence) == (most, 2**32 - 1)


def test_a_type_of_several_topics_is_declared_once(tmp_path):
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        for topic in ("/a", "/b", "/c"):
            log.write(topic, String("x"), log_time_ns=0)
    with log.path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert [schema.name for schema in summary.schemas.values()] == [String.TYPE]
    assert {channel.schema_id for channel in summary.channels.values()} == {1}


def test_bytes_that_are_no_ros_message_have_no_schema_whatever_topic_they_are_on(tmp_path):
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        log.write(LEFT_TARGET, b"anything", log_time_ns=0, type_name="pkg/msg/X", opaque=True)
    with log.path.open("rb") as file:
        (channel,) = make_reader(file).get_summary().channels.values()
    assert (channel.topic, channel.message_encoding, channel.schema_id) == (LEFT_TARGET, "application/octet-stream", 0)


def test_one_channel_more_than_can_be_numbered_is_refused(tmp_path, monkeypatch):
    assert MAX_CHANNELS == 65535
    monkeypatch.setattr("recorders.writing.writer.MAX_CHANNELS", 3)
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        for number in range(3):
            log.write(f"/{number}", b"", log_time_ns=0, opaque=True)
        with pytest.raises(MessageError, match="/one/more: a log holds no more than 3 channels"):
            log.write("/one/more", b"", log_time_ns=0, opaque=True)
        log.write("/0", b"", log_time_ns=0, opaque=True)
    assert LogReader(log.path).counts == {"/0": 2, "/1": 1, "/2": 1}


@pytest.mark.campaign
def test_as_many_channels_as_mcap_can_number(tmp_path):
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        for number in range(MAX_CHANNELS):
            log.write(f"/topic/{number}", b"", log_time_ns=0, opaque=True)
        with pytest.raises(MessageError, match="/one/more: a log holds no more than 65535 channels"):
            log.write("/one/more", b"", log_time_ns=0, opaque=True)
        log.write("/topic/0", b"", log_time_ns=0, opaque=True)
    assert LogReader(tmp_path / "log.mcap").counts["/topic/0"] == 2
