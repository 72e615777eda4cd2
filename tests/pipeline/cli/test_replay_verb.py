"""`replay --play`: anyone who subscribes gets the recorded bytes on the original keys, at the pace asked for."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import Any

import pytest
import zenoh
from episodes import PERIOD_NS, write_episode
from here import reenact_here
from processes import complaint, start, wait_for_line
from waiting import wait_until

from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET
from recorders.protocol.stream import Offer
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver
from recorders.wire.session import SessionConfig, open_session
from recorders.writing.writer import LogWriter

SAMPLES = 9


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("replay") / "log.mcap", samples=SAMPLES)


class Listener:
    """Subscribes as anyone would, and keeps what comes: key and payload."""

    def __init__(self, session: zenoh.Session) -> None:
        self._lock = Lock()
        self._heard: list[tuple[str, bytes]] = []
        self._subscriber = session.declare_subscriber("**", self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self._heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    def messages(self) -> list[tuple[str, bytes]]:
        with self._lock:
            return [entry for entry in self._heard if not entry[0].endswith("replay/batch")]


def play(folder: Path, *arguments: object) -> tuple[dict[str, Any], list[tuple[str, bytes]]]:
    """Play to a listener; returns the result, and key and payload of what came."""
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        listener = Listener(session)
        with start("replay", *arguments, "--play", "--connect", endpoint, "--json", cwd=folder) as process:
            wait_for_line(process, "whoever listens may lose messages")
            printed, said = process.communicate(timeout=120)
        assert process.returncode == 0, said
        result = json.loads(printed)
        wait_until(lambda: len(listener.messages()) >= result["messages"])
        return result, listener.messages()


def test_the_bytes_and_keys_are_those_of_the_log(log: Path, tmp_path: Path) -> None:
    result, heard = play(tmp_path, log, "--rate", 50)
    recorded = [("reenact" + record.topic, record.data) for record in LogReader(log)]
    assert heard == recorded
    assert result["messages"] == len(recorded)


class Timed:
    """A consumer that notes when it was offered a stream, and when it had all of it [s]."""

    def hello(self, offer: Offer) -> int:
        self.offered_s = time.monotonic()
        return 0

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        count = len(list(messages))
        self.through_s = time.monotonic()
        return {"count": count}


def test_it_keeps_the_pace(log: Path, tmp_path: Path) -> None:
    rate, endpoint, consumer = 4.0, free_endpoint(), Timed()
    with open_session(SessionConfig(listen=(endpoint,))) as session, Receiver(session) as receiver:
        paced = ("--rate", rate, "--await", "learner", "--connect", endpoint)
        with start("replay", log, "--play", *paced, cwd=tmp_path) as process:
            receiver.serve(consumer, wait_s=120.0)
            _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert consumer.through_s - consumer.offered_s >= SAMPLES * PERIOD_NS / 1e9 / rate


def test_a_pace_that_cannot_be_kept_slips_and_the_result_says_so(tmp_path: Path) -> None:
    """Messages a nanosecond apart: no machine sends them in time."""
    with LogWriter(tmp_path / "log.mcap", manifest={}) as writer:
        for at in range(2000):
            writer.write(LEFT_TARGET, PoseStamped(at, [0.3, 0.2, 0.7]), log_time_ns=at)
    result, heard = play(tmp_path, tmp_path / "log.mcap", "--rate", 1)
    assert len(heard) == result["messages"] == 2000
    assert result["slipped_s"] > 0.0


def test_another_namespace_other_names_chosen_topics_twice(log: Path, tmp_path: Path) -> None:
    options = ("--namespace", "lab/one", "--topic", LEFT_TARGET, "--map", f"{LEFT_TARGET}=/goal", "--loop", 2)
    _, heard = play(tmp_path, log, *options, "--end", 0.5, "--rate", 100)
    targets = [record.data for record in LogReader(log) if record.topic == LEFT_TARGET][:3]
    assert heard == [("lab/one/goal", data) for data in targets * 2]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--rate", 0.01), "rate: expected 0.1 to 1000"),
        (("--play", "--epochs", 3), "--play: expected none"),
        (("--ros", 2, "--rate", 1, "--wait-for", f"{LEFT_TARGET}=1"), "--wait-for: expected --play beside it"),
        (("--loop", 2), "expected --play beside them"),
        (("--play", "--topic", "/nothing"), "no topic /nothing"),
        (("--play", "--map", f"{LEFT_TARGET}=/a//b*"), "topic: expected names with '/' between them"),
        (("--play", "--map", f"{LEFT_TARGET}=/@x/**"), "topic: expected names with '/' between them"),
        (("--play", "--map", f"{LEFT_TARGET}={RIGHT_TARGET}"), "each topic under a name of its own"),
        (("--play", "--start", "1e300"), "--start: expected seconds from 0 to 18446744073.709551615"),
        (("--play", "--end", "soon"), "--end: expected seconds from 0 to 18446744073.709551615"),
        (("--play", "--start", 2, "--end", 1), "slice: expected 0 <= start < end"),
        (("--play", "--start", "1e9"), "slice from 1000000000 s to the end, found none"),
        (("--batch-size", 64, "--window", 1), "expected 1 <= batch size <= window, found batch size 64 and window 1"),
        (("--map", "nonsense"), "--map: expected FOREIGN=OURS"),
        (("--as-recorded",), "expected the phase markers of one recorded run, found none"),
        (("--namespace", "/x"), "namespace: expected"),
        (("--await", "a/b"), "name: expected"),
        (("--wait", "inf"), "wait"),
    ],
)
def test_bad_usage_is_one_clear_line(log: Path, tmp_path: Path, options: tuple[object, ...], expected: str) -> None:
    assert expected in complaint(reenact_here("replay", log, *options, "--connect", free_endpoint(), cwd=tmp_path))
