"""Types and schemas travel with a replay: into any recorder, early or late, and nothing hostile comes of it."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from recorders.errors import WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.recording.live_recorder import LiveRecorder
from recorders.wire.channel_table import MAX_TABLE, SenderChannels, from_json, published_channels, table_key, to_json
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.sources.playback import Playback, PlaybackConfig
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

SENDER = "0123456789abcdef" * 2
TEXT = b"\0\1\0\0\1\0\0\0\0"
CHANNELS = (
    DeclaredChannel(
        "/gauge", "cdr", (("offered_qos_profiles", "- reliable"),), ("my/msg/Gauge", "ros2msg", b"float64 value")
    ),
    DeclaredChannel("/proto", "protobuf", (), ("foo.Bar", "protobuf", b"\x0a\x07foo.Bar\x00\xff")),
    DeclaredChannel("/json", "json", (), ("Thing", "jsonschema", b'{"type": "object"}')),
    DeclaredChannel("/ros1", "ros1", (), ("my/Gauge", "ros1msg", b"float64 value")),
    DeclaredChannel("/text", "cdr", (), ("std_msgs/msg/String", "ros2msg", b"# another text of it\nstring data\n")),
    DeclaredChannel(
        "/robot_description", "cdr", (), ("std_msgs/msg/String", "ros2msg", b"# another text of it\nstring data\n")
    ),
    DeclaredChannel("/untyped", "cdr"),
    DeclaredChannel("/two", "json", (), ("Thing", "jsonschema", b'{"type": "object"}')),
    DeclaredChannel("/two", "protobuf", (), ("foo.Bar", "protobuf", b"\x0a\x07foo.Bar\x00\xff")),
)


def write(path: Path, channels: tuple[DeclaredChannel, ...] = CHANNELS) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for number, channel in enumerate(channels):
            schema = writer.register_schema(*channel.schema) if channel.schema else 0
            place = writer.register_channel(channel.topic, channel.encoding, schema, dict(channel.metadata))
            for step in range(3):
                writer.add_message(place, step * 10 + number, TEXT, step * 10 + number, step)
        writer.finish()
    return path


def declared(path: Path) -> set[DeclaredChannel]:
    """Return the channels of a log that have messages, as the library reads them."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    found = set()
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        metadata = tuple((name, text) for name, text in channel.metadata.items() if name != "sequence")
        texts = (schema.name, schema.encoding, schema.data) if schema else None
        found.add(DeclaredChannel(channel.topic, channel.message_encoding, metadata, texts))
    return found


@pytest.mark.parametrize("batch", [1, 4])
@pytest.mark.parametrize("consumers", [(), ("recorder",)])
def test_a_replay_that_is_recorded_has_the_channels_of_its_log(
    tmp_path: Path, batch: int, consumers: tuple[str, ...]
) -> None:
    endpoint, log = free_endpoint(), write(tmp_path / "log.mcap")
    playback = Playback([log], PlaybackConfig(renames={"/gauge": "/renamed"}))
    config = SenderConfig(consumers=consumers, batch_size=batch, wait_s=120.0)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as hearing,
        open_session(SessionConfig(connect=(endpoint,))) as playing,
        LiveRecorder(tmp_path / "out.mcap") as recorder,
        Receiver(hearing, config=ReceiverConfig(name="recorder", live=True)) as receiver,
    ):
        if consumers:
            with ThreadPoolExecutor() as threads:
                recording = threads.submit(recorder.run, receiver, stop_at_stream_end=True)
                ZenohTransport(playing, config=config, channels=playback.channels).deliver(
                    playback.offer(), playback.stream
                )
                recording.result(timeout=120)
        else:  # the sender is gone before anything is recorded
            ZenohTransport(playing, config=config, channels=playback.channels).deliver(
                playback.offer(), playback.stream
            )
            playing.close()
            recorder.run(receiver, stopped=lambda: recorder.recording.messages == 3 * len(CHANNELS))
    renamed = {
        DeclaredChannel("/renamed", *[getattr(CHANNELS[0], name) for name in ("encoding", "metadata", "schema")])
    }
    assert declared(tmp_path / "out.mcap") == {*CHANNELS[1:], *renamed}
    assert recorder.recording.opaque == {"/untyped": 3}


def test_who_comes_late_asks() -> None:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as playing,
        published_channels(playing, "reenact", SENDER, CHANNELS),
        open_session(SessionConfig(connect=(endpoint,))) as hearing,
        SenderChannels(hearing, "reenact") as tables,
    ):
        sender = bytes.fromhex(SENDER)
        assert tables.find(sender, "/gauge", "") == CHANNELS[0]
        assert tables.find(sender, "/two", "foo.Bar") == CHANNELS[-1]
        assert tables.find(sender, "/two", "other") is None
        assert tables.find(sender, "/unknown", "") is None
        assert tables.find(bytes(16), "/gauge", "") is None


def test_a_table_reads_back() -> None:
    assert tuple(from_json(to_json(CHANNELS))) == CHANNELS


def test_a_table_that_is_too_large_is_said_not_sent(caplog: pytest.LogCaptureFixture) -> None:
    large = [DeclaredChannel("/t", "json", (), ("T", "jsonschema", bytes(MAX_TABLE)))]
    with open_session(SessionConfig()) as session, published_channels(session, "reenact", SENDER, large):
        pass
    (line,) = caplog.messages
    assert line.startswith("types and schemas take ")


GOOD = json.loads(to_json(CHANNELS[:1]))
BAD: tuple[Any, ...] = (
    {},
    [],
    GOOD | {"version": 2},
    GOOD | {"channels": {}},
    GOOD | {"channels": [{"topic": "/t"}]},
    GOOD | {"channels": [GOOD["channels"][0] | {"schema": 1}]},
    GOOD | {"channels": [GOOD["channels"][0] | {"schema": -1}]},
    GOOD | {"channels": [GOOD["channels"][0] | {"topic": "/" + "x" * 2000}]},
    GOOD | {"channels": [GOOD["channels"][0] | {"topic": "\ud800"}]},
    GOOD | {"channels": [GOOD["channels"][0] | {"metadata": {"a": 1}}]},
    GOOD | {"schemas": [{"name": "a", "encoding": "b", "data": "no base64!"}]},
)


@pytest.mark.parametrize("table", BAD, ids=range(len(BAD)))
def test_what_is_no_table_is_refused(table: object) -> None:
    with pytest.raises(WireError, match="channels: expected"):
        from_json(json.dumps(table).encode())


@settings(max_examples=50)
@given(st.binary(max_size=100))
def test_no_bytes_do_harm(data: bytes) -> None:
    with pytest.raises(WireError):
        from_json(data)


def test_an_answer_that_is_no_table_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    endpoint, key = free_endpoint(), table_key("reenact", SENDER)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as playing,
        playing.declare_queryable(key, lambda query: query.reply(query.key_expr, b"{}")),
        open_session(SessionConfig(connect=(endpoint,))) as hearing,
        SenderChannels(hearing, "reenact") as tables,
    ):
        assert tables.find(bytes.fromhex(SENDER), "/t", "") is None
        assert tables.find(bytes.fromhex(SENDER), "/t", "") is None
    (line,) = caplog.messages
    assert line.startswith("channels: expected topics")
