"""Streams over a ROS domain: acknowledged ones are exact, whichever way they travel, and as ordinary messages too."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh
from collector import Collector

from recorders.errors import ConfigError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS
from recorders.protocol.stream import Offer
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.subscription import LiveMessage
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

COUNT = 500
OFFER = Offer(run="ab" * 16, schedule={}, logs=[])


def message(index: int) -> RecordedMessage:
    topic = LEARNER_TOPICS[index % 3]
    return RecordedMessage(topic.name, topic.type, f"payload {index}".encode() * (index % 7), index, index * 1_000)


def stream_from(start: int) -> Iterator[RecordedMessage]:
    return (message(index) for index in range(start, COUNT))


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
def test_everything_arrives_in_order_whatever_the_receiver_calls_its_topics_and_wants_beside_the_stream(
    sessions: tuple[zenoh.Session, zenoh.Session], batch_size: int, topics: dict[str, str] | None
) -> None:
    rules = f"/mine:={LEARNER_TOPICS[0].name}", "__ns:=/lab"
    config = ReceiverConfig(keys=keys("learner", *rules), topics=topics)
    sending = SenderConfig(keys=keys("replay"), batch_size=batch_size, wait_s=60.0, patience_s=60.0)
    with Receiver(sessions[1], config=config) as receiver, ThreadPoolExecutor() as pool:
        sent = pool.submit(ZenohTransport(sessions[0], config=sending).deliver, OFFER, stream_from)
        result = receiver.serve(Collector(), wait_s=60.0)
        assert sent.result() == {"learner": result}
    assert result == Collector().consume(stream_from(0))


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
    renamed = [each._replace(topic="/mine") if each.topic == LEARNER_TOPICS[0].name else each for each in sent]
    assert [each.record for each in found] == renamed
    numbers = [each.origin.sequence for each in found if each.origin is not None]
    assert numbers == [index // 3 + 1 for index in range(COUNT) if index % 3 != 1]


def test_a_sender_that_renames_topics_can_be_awaited_by_nobody() -> None:
    with pytest.raises(ConfigError, match="--remap: expected none where learner is awaited"):
        SenderConfig(keys=keys("replay", "/a:=/b"))
