"""The contract of every transport: all of the stream, in order, from where the consumer wants it, or an error."""

import json
import math
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import collector
import pytest
from collector import Collector
from numbered_stream import OFFER, message, numbered

from recorders.errors import ConfigError, LogError, ReenactError, WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import MAX_PAYLOAD, Frame, FrameType
from recorders.protocol.packets import Publish
from recorders.protocol.stream import WINDOW_BYTES, Offer
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.sender import StreamSender
from recorders.wire.session import SessionConfig, open_session
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import InProcess, Transport
from replay.transports.zenoh import ZenohTransport

PATIENCE_S = 120.0  # for a process to start
PATIENT = SenderConfig(wait_s=PATIENCE_S)
COUNT = 2_000


def stream_from(start: int) -> Iterator[RecordedMessage]:
    return numbered(start, COUNT)


def expected(start: int = 0) -> dict[str, Any]:
    return Collector(start=start).consume(stream_from(start))


class Feed:
    """Delivers to a collector with given options; afterwards tells what the collector said itself."""

    def __init__(self, endpoint: str | None, config: SenderConfig | None) -> None:
        self._endpoint = endpoint
        self._config = config
        self.said: dict[str, Any] | None = None

    def __call__(
        self, options: dict[str, Any], stream: Callable[[int], Iterator[RecordedMessage]] = stream_from
    ) -> dict[str, Any]:
        if self._endpoint is None:
            transport: Transport = InProcess({"learner": Collector(**options)})
            return transport.deliver(OFFER, stream)["learner"]
        command = [sys.executable, collector.__file__, self._endpoint, "learner", json.dumps(options)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                with open_session(SessionConfig(listen=(self._endpoint,))) as session:
                    transport = ZenohTransport(session, config=self._config)
                    return transport.deliver(OFFER, stream)["learner"]
            finally:
                if "refuse" in options:
                    process.kill()  # it waits for another offer
                out, _ = process.communicate(timeout=120)
                self.said = json.loads(out) if out else None


CONFIGS = {
    "in-process": None,
    "zenoh, window 1, one a payload": SenderConfig(window=1, batch_size=1, wait_s=PATIENCE_S),
    "zenoh, window 64, one a payload": SenderConfig(window=64, batch_size=1, wait_s=PATIENCE_S),
    "zenoh, window 1024, batches of 64": SenderConfig(window=1024, batch_size=64, wait_s=PATIENCE_S),
    "zenoh, window 100, batches of 7": SenderConfig(window=100, batch_size=7, wait_s=PATIENCE_S),
}


EXTREMES = ("in-process", "zenoh, window 1, one a payload", "zenoh, window 1024, batches of 64")
FEEDS = [pytest.param(name, marks=() if name in EXTREMES else pytest.mark.campaign) for name in CONFIGS]


@pytest.fixture(params=FEEDS)
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
        feed({"refuse": "another robot"})


def test_a_consumer_that_fails_is_named_with_its_reason(feed: Feed) -> None:
    with pytest.raises(ReenactError, match="message 777 is not wanted"):
        feed({"fail_at": 777})


def test_a_stream_that_fails_is_never_taken_for_a_short_one(feed: Feed) -> None:
    def broken(start: int) -> Iterator[RecordedMessage]:
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
    with open_session(SessionConfig(listen=(free_endpoint(),))) as session:
        transport = ZenohTransport(session, config=SenderConfig(wait_s=0.5))
        with pytest.raises(WireError, match="no consumer named 'learner'"):
            transport.deliver(OFFER, stream_from)


@contextmanager
def collectors(endpoint: str, **options: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Run collectors by name, each in a process of its own; when the block ends, what each said is in the result."""
    processes = {
        name: subprocess.Popen(
            [sys.executable, collector.__file__, endpoint, name, json.dumps(chosen)], stdout=subprocess.PIPE, text=True
        )
        for name, chosen in options.items()
    }
    said: dict[str, Any] = {}
    try:
        yield said
        for name, process in processes.items():
            if "refuse" not in options[name]:  # that one waits for another offer
                out, _ = process.communicate(timeout=120)
                said[name] = json.loads(out)
    finally:
        for process in processes.values():
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ("window", "batch", "frames"),
    [(64, 1, 0), (256, 16, 1), *(pytest.param(*row, marks=pytest.mark.campaign) for row in ((64, 1, 3), (256, 16, 3)))],
)
def test_frames_that_the_network_loses_are_sent_again(
    window: int, batch: int, frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zenoh drops what a stalled link cannot hold; here the link loses some frames and then the end."""
    endpoint = free_endpoint()
    lost: list[Frame] = []

    class Lossy(StreamSender):
        def _publish(self, action: Publish) -> None:
            frame = action.frame
            lose = len(lost) < frames and frame.first >= 300 * (len(lost) + 1)
            lose = lose or (len(lost) == frames and frame.kind is FrameType.END)
            if lose:
                lost.append(frame)
            else:
                super()._publish(action)

    monkeypatch.setattr("replay.transports.zenoh.StreamSender", Lossy)
    config = SenderConfig(window=window, batch_size=batch, wait_s=PATIENCE_S)
    with collectors(endpoint, learner={}) as said, open_session(SessionConfig(listen=(endpoint,))) as session:
        assert ZenohTransport(session, config=config).deliver(OFFER, stream_from) == {"learner": expected()}
    assert [frame.kind for frame in lost][frames:] == [FrameType.END]
    assert said == {"learner": expected()}


@pytest.mark.parametrize(("window", "batch"), [(1, 1), (8, 1), (64, 16)])
def test_no_more_than_the_window_is_under_way(window: int, batch: int) -> None:
    endpoint, under_way, consumed = free_endpoint(), [0], [0]

    def counted(start: int) -> Iterator[RecordedMessage]:
        for index in range(start, 300):
            under_way.append(index - consumed[-1])
            yield message(index)

    with collectors(endpoint, learner={"delay_s": 0.0005}), open_session(SessionConfig(listen=(endpoint,))) as session:
        config = SenderConfig(window=window, batch_size=batch, wait_s=PATIENCE_S)
        ZenohTransport(session, config=config, on_progress=consumed.append).deliver(OFFER, counted)
    assert max(under_way) <= window + batch  # a batch is gathered before there is room for it
    assert consumed[-1] == 300


def test_two_consumers_both_get_everything_at_the_pace_of_the_slower() -> None:
    endpoint = free_endpoint()
    with collectors(endpoint, anna={}, bob={"delay_s": 0.001, "start": 1_000}) as said:
        with open_session(SessionConfig(listen=(endpoint,))) as session:
            config = SenderConfig(consumers=("anna", "bob"), wait_s=PATIENCE_S)
            results = ZenohTransport(session, config=config).deliver(OFFER, stream_from)
    assert results == {"anna": expected(), "bob": expected(1_000)} == said


def test_ends_that_share_no_key_refuse_each_other_and_say_so(tmp_path: Path) -> None:
    endpoint, path = free_endpoint(), tmp_path / "stream.key"
    path.write_text("ab" * 32)
    path.chmod(0o600)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as hearing,
        open_session(SessionConfig(connect=(endpoint,))) as session,
        Receiver(hearing, config=ReceiverConfig(key_file=path)) as receiver,
        ThreadPoolExecutor() as threads,
    ):
        served = threads.submit(receiver.serve, Collector(), wait_s=PATIENCE_S)
        other = ZenohTransport(session, config=SenderConfig(wait_s=0.2))
        with pytest.raises(WireError, match=r"not with the key of this replay.*the offer is not sealed with the key"):
            other.deliver(OFFER, stream_from)
        assert sum(other.refused.values()) > 0
        assert sum(receiver.refused.values()) > 0
        same = ZenohTransport(session, config=SenderConfig(wait_s=PATIENCE_S, key_file=path))
        assert same.deliver(OFFER, stream_from) == {"learner": expected()}
        assert served.result(timeout=120) == expected()


def test_who_accepted_is_told_when_another_refuses() -> None:
    endpoint = free_endpoint()
    with collectors(endpoint, anna={}, bob={"refuse": "another robot"}) as said:
        with open_session(SessionConfig(listen=(endpoint,))) as session:
            transport = ZenohTransport(session, config=SenderConfig(consumers=("anna", "bob"), wait_s=PATIENCE_S))
            with pytest.raises(WireError, match="bob: another robot"):
                transport.deliver(OFFER, stream_from)
    assert "the sender gave up at message 0: bob: another robot" in said["anna"]["error"]


def test_a_message_too_large_to_be_received_is_refused_before_it_is_sent() -> None:
    endpoint = free_endpoint()

    def large(start: int) -> Iterator[RecordedMessage]:
        yield message(0)
        yield message(1)._replace(data=bytes(MAX_PAYLOAD + 1))

    with collectors(endpoint, learner={}) as said, open_session(SessionConfig(listen=(endpoint,))) as session:
        with pytest.raises(WireError, match=f"expected at most {MAX_PAYLOAD} bytes"):
            ZenohTransport(session, config=PATIENT).deliver(OFFER, large)
    assert "expected at most" in said["learner"]["error"]


def test_large_messages_travel_in_small_batches() -> None:
    endpoint = free_endpoint()

    def large(start: int) -> Iterator[RecordedMessage]:
        return (message(index)._replace(data=bytes(3 << 20)) for index in range(start, 12))

    with collectors(endpoint, learner={}), open_session(SessionConfig(listen=(endpoint,))) as session:
        assert ZenohTransport(session, config=PATIENT).deliver(OFFER, large)["learner"]["count"] == 12


class Waiting:
    """Takes the first message, and the others once the sender can send no more."""

    def __init__(self, blocked: threading.Event) -> None:
        self._blocked = blocked

    def hello(self, offer: Offer) -> int:
        return 0

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        next(messages)
        assert self._blocked.wait(120)
        return {"count": 1 + sum(1 for _ in messages)}


def test_no_more_than_so_many_bytes_are_under_way() -> None:
    """Of messages of 20 MB three, whatever the window allows."""
    endpoint, size, blocked = free_endpoint(), 20 << 20, threading.Event()
    under_way: list[int] = []

    def large(start: int) -> Iterator[RecordedMessage]:
        for index in range(start, 8):
            if (index + 1) * size > WINDOW_BYTES:
                blocked.set()
            yield message(index)._replace(data=bytes(size))

    class Watched(Receiver):
        def consumed(self, frame: Frame) -> None:
            under_way.append(self.progress.received - self.progress.next)
            super().consumed(frame)

    with (
        open_session(SessionConfig(listen=(endpoint,))) as hearing,
        open_session(SessionConfig(connect=(endpoint,))) as session,
        Watched(hearing) as receiver,
        ThreadPoolExecutor() as threads,
    ):
        served = threads.submit(receiver.serve, Waiting(blocked))
        ZenohTransport(session, config=SenderConfig(batch_size=1, wait_s=PATIENCE_S)).deliver(OFFER, large)
        assert served.result(timeout=120) == {"count": 8}
    assert max(under_way) * size <= WINDOW_BYTES


def test_a_start_beyond_the_end_is_refused() -> None:
    endpoint = free_endpoint()
    with collectors(endpoint, learner={"start": COUNT + 1}), open_session(SessionConfig(listen=(endpoint,))) as session:
        with pytest.raises(WireError, match=f"wants message {COUNT + 1} of a stream that has {COUNT}"):
            ZenohTransport(session, config=PATIENT).deliver(replace(OFFER, messages=COUNT), stream_from)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SenderConfig(consumers=("a b",)),
        lambda: SenderConfig(consumers=("a/*",)),
        lambda: NamespaceKeys("/x"),
        lambda: NamespaceKeys(""),
    ],
)
def test_names_that_cannot_be_keys_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(WireError, match="expected"):
        make()


@pytest.mark.parametrize(
    "options",
    [{"window": 0}, {"batch_size": 2, "window": 1}, {"wait_s": math.inf}, {"wait_s": -1.0}, {"consumers": ("a", "a")}],
)
def test_numbers_out_of_range_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="expected"):
        SenderConfig(**options)
