"""MCAP to the letter: each variant that the format allows of a log reads, is sound, is recovered whole, is the same."""

import os
from collections import Counter
from pathlib import Path

import pytest
from every_variant import FLAGS, Data, Variant, described, variants
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from pipeline.cli.logs.diff_files import diff
from recorders.mcap_format.manifest import METADATA_NAME
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import recover

NOTHING = Data()
EVERYTHING = Data(
    [Schema(id=1, data=b"\x04\x05\x06", encoding="c", name="Example"), Schema(7, b"", "ros2msg", "Empty")],
    [
        Channel(1, "/one", "a", {"foo": "bar"}, 1),
        Channel(2, "/schemaless", "b", {}, 0),
        Channel(3, "/two", "cdr", {}, 7),
        Channel(9, "/silent", "cdr", {}, 7),
    ],
    [Message(1 + k % 3, 10 + k // 2 % 4, bytes(range(k)), 5 + k, 100 + k) for k in range(10)],
    [
        Attachment(1, 2, "notes", "text/plain", b"first"),
        Attachment(3, 4, "notes", "", b""),
        Attachment(0, 0, "b", "", b"3"),
    ],
    [Metadata("of one name", {"a": "1"}), Metadata("other", {}), Metadata("of one name", {"a": "2", "b": "3"})],
)
FOLDER = os.environ.get("REENACT_CONFORMANCE", "")


def all_of(path):
    """Return all the messages, attachments and metadata in a log, by the library, with their channels and schemas."""
    schemas, channels, messages, attachments, metadata = {}, {}, [], [], []
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            match record:
                case Schema():
                    schemas[record.id] = record
                case Channel():
                    channels[record.id] = record
                case Message():
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    messages.append((
                        (channel.topic, channel.message_encoding, channel.metadata),
                        schema and (schema.name, schema.encoding, schema.data),
                        (record.sequence, record.log_time, record.publish_time, record.data),
                    ))  # fmt: skip
                case Attachment():
                    attachments.append(record)
                case Metadata():
                    metadata.append(record)
    return messages, attachments, [each for each in metadata if each.name != METADATA_NAME]


def expected(data):
    """Return the same of what a log was made of."""
    schemas = {schema.id: (schema.name, schema.encoding, schema.data) for schema in data.schemas}
    channels = {each.id: each for each in data.channels}
    messages = [
        (
            (channel.topic, channel.message_encoding, channel.metadata),
            schemas.get(channel.schema_id),
            (message.sequence, message.log_time, message.publish_time, message.data),
        )
        for message in data.messages
        for channel in (channels[message.channel_id],)
    ]
    return messages, list(data.attachments), list(data.metadata)


def check(path, data, base):
    """Check a log on every surface against what it was made of, and against another log with the same data."""
    reader = LogReader(path)
    assert list(reader) == sorted(data.stamped, key=lambda record: record.log_time_ns)
    assert list(reader.records(file_order=True)) == data.stamped
    assert reader.counts == Counter(message.topic for message in data.stamped)
    names = {schema.id: schema.name for schema in data.schemas}
    assert reader.topics == {each.topic: names.get(each.schema_id, "") for each in data.channels}
    assert reader.attachments == tuple(each.name for each in data.attachments)
    for name in set(reader.attachments):
        same_name = [each.data for each in data.attachments if each.name == name]
        assert [reader.attachment(name, which=k) for k in range(len(same_name))] == same_name
    assert reader.metadata == tuple((each.name, each.metadata) for each in data.metadata)

    summary = summarise(path)
    assert (summary.sound, summary.to_dict()["messages"]) == (True, len(data.messages)), summary.to_dict()
    assert [(topic.topic, topic.count) for topic in summary.topics.values()] == [
        (topic, sum(m.topic == topic for m in data.stamped)) for topic in dict.fromkeys(m.topic for m in data.stamped)
    ]

    recovered = path.parent / "recovered" / path.name
    recovery = recover(path, recovered)
    assert (recovery.complete, recovery.lost, recovery.lost_attachments, recovery.damage) == (True, {}, (), ())
    assert all_of(recovered) == expected(data)
    assert diff(base, path) is None
    assert diff(path, recovered) is None


def check_variants(folder, data, chosen):
    """Check variants of a log, beside the one without any flag."""
    (folder / "recovered").mkdir()
    base = folder / "base.mcap"
    Variant(()).write(base, data)
    for flags in chosen:
        path = folder / f"{'-'.join(sorted(flags)) or 'plain'}.mcap"
        Variant(flags).write(path, data)
        check(path, data, base)


def test_every_variant_of_a_log_without_data_is_the_same_log(tmp_path):
    check_variants(tmp_path, NOTHING, filter(frozenset({"st", "sum", "pad"}).issuperset, variants()))


def test_every_pair_of_flags_switched_on_or_off_is_the_same_log(tmp_path):
    check_variants(
        tmp_path, EVERYTHING, (flags for flags in variants() if len(flags) <= 2 or len(FLAGS) - len(flags) <= 2)
    )


@pytest.mark.campaign
def test_every_variant_of_a_log_is_the_same_log(tmp_path):
    check_variants(tmp_path, EVERYTHING, variants())


@pytest.mark.skipif(not FOLDER, reason="REENACT_CONFORMANCE does not name the folder of MCAP's conformance files")
def test_mcaps_own_conformance_files(tmp_path):
    logs = sorted(Path(FOLDER).rglob("*.mcap"))
    assert logs, f"expected MCAP files below {FOLDER}, found none"
    (tmp_path / "recovered").mkdir()
    for source in logs:
        path = tmp_path / source.name
        path.write_bytes(source.read_bytes())
        kind = source.name.partition("-")[0].removesuffix(".mcap")
        check(path, described(source.with_suffix(".json")), source.with_name(f"{kind}.mcap"))
