"""Streams over a ROS domain: acknowledged ones are exact, whichever way they travel, and as ordinary messages too."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh
from collector import Collector
from numbered_stream import OFFER, message, numbered

from recorders.errors import ConfigError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS
from recorders.reading.reader import LogReader
from recorders.recording.live_recorder import LiveRecorder
from recorders.recording.ros_channels import domain_channels
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.subscription import LiveMessage
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

COUNT = 500


def stream_from(start: int) -> Iterator[RecordedMessage]:
    return numbered(start, COUNT)


def renamed(record: RecordedMessage) -> RecordedMessage:
    return record._replace(topic="/mine") if record.topic == LEARNER_TOPICS[0].name else record


def keys(name: str, *rules: str) -> RosKeys:
    return RosKeys(9, NodeName.remapped(name, "/", rules))


@pytest.fixture
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """One session for the sender, one for the receiver."""
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as sending,
        open_session(SessionConfig(connect=(endpoint,))) as receiving,
    ):
        yield sending, receiving


@pytest.mark.parametrize("topics", [None, {"/mine": LEARNER_TOPICS[0].type}])
@pytest.mark.parametrize("batch_size", [1, 64])
def test_everything_arrives_in_order_under_the_receivers_names_whatever_it_wants_beside_the_stream(
    sessions: tuple[zenoh.Session, zenoh.Session], batch_size: int, topics: dict[str, str] | None
) -> None:
    rules = f"/mine:={LEARNER_TOPICS[0].name}", "__ns:=/lab"
    config = ReceiverConfig(keys=keys("learner", *rules), topics=topics)
    sending = SenderConfig(keys=keys("replay"), batch_size=batch_size, wait_s=60.0, patience_s=60.0)
    with Receiver(sessions[1], config=config) as receiver, ThreadPoolExecutor() as pool:
        sent = pool.submit(ZenohTransport(sessions[0], config=sending).deliver, OFFER, stream_from)
        result = receiver.serve(Collector(), wait_s=60.0)
        assert sent.result() == {"learner": result}
    assert result == Collector().consume(map(renamed, stream_from(0)))


def test_an_awaited_recorder_records_its_own_names(
    sessions: tuple[zenoh.Session, zenoh.Session], tmp_path: Path
) -> None:
    config = ReceiverConfig(name="recorder", keys=keys("recorder", f"/mine:={LEARNER_TOPICS[0].name}"), live=True)
    sending = SenderConfig(("recorder",), keys=keys("replay"), batch_size=1, wait_s=60.0, patience_s=60.0)
    with (
        Receiver(sessions[1], config=config) as receiver,
        LiveRecorder(tmp_path / "log.mcap") as recorder,
        ThreadPoolExecutor() as pool,
    ):
        sent = pool.submit(ZenohTransport(sessions[0], config=sending).deliver, OFFER, stream_from)
        recorder.run(receiver, stop_at_stream_end=True)
        assert sent.result()["recorder"]["messages"] == COUNT
    found = [(record.topic, record.data) for record in LogReader(tmp_path / "log.mcap")]
    assert found == [(record.topic, record.data) for record in map(renamed, stream_from(0))]


@pytest.mark.parametrize("awaited", [(), ("recorder",)])
def test_a_topic_under_the_recorders_name_has_the_channel_that_its_sender_declares(
    sessions: tuple[zenoh.Session, zenoh.Session], tmp_path: Path, awaited: tuple[str, ...]
) -> None:
    topic = LEARNER_TOPICS[0]
    made_by, schema = ("made_by", "another program"), (topic.type, "ros2msg", b"float64 theirs")
    declared = DeclaredChannel(topic.name, "cdr", (made_by,), schema)
    rules = keys("recorder", f"/mine:={topic.name}")
    config = ReceiverConfig(name="recorder", keys=rules, live=True)
    sending = SenderConfig(awaited, keys=keys("replay"), batch_size=1, wait_s=60.0, patience_s=60.0)
    transport = ZenohTransport(sessions[0], config=sending, channels=[declared])
    with (
        domain_channels(sessions[1], rules) as channels,
        Receiver(sessions[1], config=config) as receiver,
        LiveRecorder(tmp_path / "log.mcap", ros=channels) as recorder,
        ThreadPoolExecutor() as pool,
    ):
        sent = pool.submit(transport.deliver, OFFER, lambda start: numbered(start, 4))
        recorder.run(receiver, stopped=lambda: recorder.recording.messages == 4 and (sent.done() or not awaited))
        sent.result()
    (channel,) = (each for each in LogReader(tmp_path / "log.mcap").channels if each.topic == "/mine")
    assert (dict(channel.metadata)["made_by"], channel.schema) == ("another program", declared.schema)


def test_a_stream_that_nobody_need_await_is_ordinary_messages_with_our_numbers_and_rmw_zenohs(
    sessions: tuple[zenoh.Session, zenoh.Session],
) -> None:
    rules = f"/mine:={LEARNER_TOPICS[0].name}", f"{LEARNER_TOPICS[1].name}:=/other"
    config = ReceiverConfig(name="recorder", keys=keys("recorder", *rules), live=True)
    sending = SenderConfig((), keys=keys("replay"), batch_size=1)
    found: list[LiveMessage] = []
    with Receiver(sessions[1], config=config) as receiver:
        ZenohTransport(sessions[0], config=sending).deliver(OFFER, stream_from)
        while len(found) + receiver.refused.total() < COUNT:
            event = receiver.next_event(0.1)
            found += [event] if isinstance(event, LiveMessage) else []
        refused = dict(receiver.refused)
    sent = [message(index) for index in range(COUNT) if index % 3 != 1]
    taken = f"{LEARNER_TOPICS[1].name}: another topic has that name here, by --remap"
    assert refused == {taken: COUNT - len(sent)}
    assert [each.record for each in found] == [*map(renamed, sent)]
    numbers = [each.origin.sequence for each in found if each.origin is not None]
    assert numbers == [index // 3 + 1 for index in range(COUNT) if index % 3 != 1]


def test_a_sender_that_renames_topics_can_be_awaited_by_nobody() -> None:
    with pytest.raises(ConfigError, match="--remap: expected none where learner is awaited"):
        SenderConfig(keys=keys("replay", "/a:=/b"))
