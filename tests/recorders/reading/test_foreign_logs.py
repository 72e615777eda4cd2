"""Logs that others' writers wrote, in our reader: every message, raw, whatever the compression and the indexes."""

import itertools

import foxglove
import pytest
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from recorders.cdr.rosbags_types import typestore
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader

STRING = "std_msgs/msg/String"
FOXGLOVE_COMPRESSIONS = [None, MCAPCompression.Lz4, MCAPCompression.Zstd]
COUNT = 60


def as_library_reads(path, *, by_time):
    """Return every message as mcap's own reader gives it, by log time or in file order."""
    with path.open("rb") as file:
        return [
            RecordedMessage(
                channel.topic, schema.name if schema else "", message.data, message.sequence, message.log_time
            )
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=by_time)
        ]


def check(path, messages):
    """Check that ours reads these (topic, type, data, log time), whole and in slices, just as the library does."""
    reader = LogReader(path)
    found = list(reader.records(file_order=True))
    assert [(item.topic, item.type, item.data, item.log_time_ns) for item in found] == messages
    assert found == as_library_reads(path, by_time=False)
    found = list(reader)
    assert found == as_library_reads(path, by_time=True)
    assert sum(reader.counts.values()) == len(found)
    assert reader.topics == {topic: kind for topic, kind, _, _ in messages}
    times = sorted({item.log_time_ns for item in found})
    for start, end in itertools.combinations(times[:: len(times) // 5], 2):
        inside = [item for item in found if start <= item.log_time_ns < end]
        assert list(reader.records(start_ns=start, end_ns=end)) == inside


def written_by_foxglove(path, **options):
    context = foxglove.Context()
    messages = []
    with foxglove.open_mcap(path, context=context, writer_options=MCAPWriteOptions(chunk_size=500, **options)):
        schemas = [("Note", "jsonschema", "json"), ("Pose", "protobuf", "protobuf")]
        channels = [
            foxglove.Channel(
                f"/{name}",
                message_encoding=encoding,
                schema=foxglove.Schema(name=name, encoding=kind, data=b"\x00{}"),
                context=context,
            )
            for name, kind, encoding in schemas
        ]
        for index in range(COUNT):
            name = schemas[index % 2][0]
            messages.append((f"/{name}", name, b'{"n": %d}' % index, 1000 + (index ^ 3) * 10))
            channels[index % 2].log(messages[-1][2], log_time=messages[-1][3])
    return messages


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", FOXGLOVE_COMPRESSIONS, ids=str)
def test_foxglove(tmp_path, compression, chunked, indexed):
    path = tmp_path / "foxglove.mcap"
    kept = {"emit_statistics": indexed, "emit_chunk_indexes": indexed, "emit_message_indexes": indexed}
    kept |= {"emit_summary_offsets": indexed, "repeat_channels": indexed, "repeat_schemas": indexed}
    check(path, written_by_foxglove(path, compression=compression, use_chunks=chunked, **kept))
    assert LogReader(path).protected


def test_foxglove_without_crcs_is_said_to_be_unprotected(tmp_path):
    path = tmp_path / "foxglove.mcap"
    none = {f"calculate_{what}": False for what in ("chunk_crcs", "data_section_crc", "summary_section_crc")}
    check(path, written_by_foxglove(path, **none))
    assert not LogReader(path).protected


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_rosbags(tmp_path, mode):
    folder, store = tmp_path / "bag", typestore()
    kind = store.types[STRING]
    messages = []
    bag = BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        connections = [bag.add_connection(topic, STRING, typestore=store) for topic in ("/a", "/b")]
        for index in range(COUNT):
            connection = connections[index % 2]
            data = bytes(store.serialize_cdr(kind(data="x" * 100_000 + str(index)), STRING))  # some MB: several chunks
            messages.append((connection.topic, STRING, data, 10**9 + index * 10**7))
            bag.write(connection, messages[-1][3], data)
    (path,) = folder.glob("*.mcap")
    check(path, messages)
    assert LogReader(path).manifest == {}
    assert not LogReader(path).protected  # it writes no CRC


@pytest.mark.parametrize("indexes", [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE])
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", CompressionType)
def test_mcap(tmp_path, compression, chunked, indexes):
    path = tmp_path / "mcap.mcap"
    messages = []
    with path.open("wb") as file:
        writer = Writer(file, 300, compression, indexes, use_chunking=chunked)
        writer.start(profile="", library="other")
        schema = writer.register_schema("Note", "jsonschema", b"{}")
        channels = [writer.register_channel("/note", "json", schema), writer.register_channel("/raw", "x", 0)]
        for index in range(COUNT):
            messages.append((("/note", "/raw")[index % 2], ("Note", "")[index % 2], bytes(index), 10**9 - index // 2))
            writer.add_message(channels[index % 2], messages[-1][3], messages[-1][2], 0, index)
        writer.finish()
    check(path, messages)
    # Unless asked, the library makes no CRC over the data section: only chunks with an index are known to be all there.
    assert LogReader(path).protected == (chunked and bool(indexes & IndexType.CHUNK))
