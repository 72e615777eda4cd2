"""The contract of every transport: all of the stream, in order, from where the consumer wants it, or an error."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import collector
import pytest
from collector import Collector

from recorders.errors import LogError, ReenactError, WireError
from recorders.records import Stamped
from recorders.stream import Offer
from recorders.topics import LEARNER_TOPICS
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.transport import InProcess, Transport
from replay.zenoh_transport import SenderConfig, ZenohTransport

COUNT = 2_000
OFFER = Offer(run="ab" * 16, schedule={}, logs=[])


def message(index: int) -> Stamped:
    topic = LEARNER_TOPICS[index % 3]
    return Stamped(topic.name, topic.type, f"payload {index}".encode() * (index % 7), index, index * 1_000)


def stream_from(start: int) -> Iterator[Stamped]:
    return (message(index) for index in range(start, COUNT))


def expected(start: int = 0) -> dict[str, Any]:
    return Collector(start=start).consume(stream_from(start))


class Feed:
    """Delivers to a collector with given options; afterwards tells what the collector said itself."""

    def __init__(self, endpoint: str | None, config: SenderConfig | None) -> None:
        self._endpoint = endpoint
        self._config = config
        self.said: dict[str, Any] | None = None

    def __call__(
        self, options: dict[str, Any], stream: Callable[[int], Iterator[Stamped]] = stream_from
    ) -> dict[str, Any]:
        if self._endpoint is None:
            options.pop("wait_s", None)
            transport: Transport = InProcess({"learner": Collector(**options)})
            return transport.deliver(OFFER, stream)["learner"]
        command = [sys.executable, collector.__file__, self._endpoint, "learner", json.dumps(options)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                with open_session(SessionConfig(listen=(self._endpoint,))) as session:
                    transport = ZenohTransport(session, config=self._config)
                    return transport.deliver(OFFER, stream)["learner"]
            finally:
                out, _ = process.communicate(timeout=30)
                self.said = json.loads(out) if out else None


CONFIGS = {
    "in-process": None,
    "zenoh, window 1, one a payload": SenderConfig(window=1, batch=1),
    "zenoh, window 64, one a payload": SenderConfig(window=64, batch=1),
    "zenoh, window 1024, batches of 64": SenderConfig(window=1024, batch=64),
    "zenoh, window 100, batches of 7": SenderConfig(window=100, batch=7),
}


@pytest.fixture(params=CONFIGS)
def feed(request: pytest.FixtureRequest) -> Feed:
    config = CONFIGS[request.param]
    return Feed(None if config is None else free_endpoint(), config)


def test_everything_arrives_in_order(feed: Feed) -> None:
    assert feed({}) == expected()


def test_the_consumer_chooses_where_to_start(feed: Feed) -> None:
    assert feed({"start": 1_234}) == expected(1_234)


def test_an_empty_stream_ends(feed: Feed) -> None:
    assert feed({"start": COUNT})["count"] == 0


def test_a_refused_offer_says_why(feed: Feed) -> None:
    with pytest.raises(ReenactError, match="another robot"):
        feed({"refuse": "another robot", "wait_s": 2.0})


def test_a_consumer_that_fails_is_named_with_its_reason(feed: Feed) -> None:
    with pytest.raises(ReenactError, match="message 777 is not wanted"):
        feed({"fail_at": 777})


def test_a_stream_that_fails_is_never_taken_for_a_short_one(feed: Feed) -> None:
    def broken(start: int) -> Iterator[Stamped]:
        for index in range(start, 500):
            yield message(index)
        raise LogError("cut off at byte 12345")

    with pytest.raises(LogError, match="cut off"):
        feed({}, broken)
    if feed.said is not None:
        assert "cut off at byte 12345" in feed.said["error"]


def test_a_slow_consumer_loses_nothing(feed: Feed) -> None:
    assert feed({"start": COUNT - 1_000, "delay_s": 0.001}) == expected(COUNT - 1_000)


def test_no_consumer_is_one_clear_error() -> None:
    with open_session(SessionConfig(connect=(free_endpoint(),))) as session:
        transport = ZenohTransport(session, config=SenderConfig(wait_s=0.5))
        with pytest.raises(WireError, match="no consumer named 'learner'"):
            transport.deliver(OFFER, stream_from)
