"""An awaited consumer gets everything in order, whatever befalls it or the connection; or an error names the gap."""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import collector
import pytest
from collector import Collector
from episodes import write_episode
from processes import command, complaint, reenact, start, wait_for_line
from proxy import Proxy
from stepped_clock import SteppedClock
from waiting import wait_until

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_OUTPUT, LEARNER_TOPICS, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.diff.divergence import first_divergence
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

EPOCHS = 40
SAMPLES = 40
CUT_S = [1.0, *(pytest.param(cut_s, marks=pytest.mark.campaign) for cut_s in (3.0, 15.0))]
SILENCE_S = 3.0
MIDDLE = 2_000_000  # bytes, of the 8.5 MB that all epochs are


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("nothing") / "log.mcap", samples=SAMPLES)


@pytest.fixture(scope="module")
def expected(log: Path) -> dict[str, Any]:
    return train([log], schedule=Schedule(epochs=EPOCHS), config=LearnerConfig(seed=5)).result()


@contextmanager
def running(*arguments: object, ready: str, cwd: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a verb, from the moment when it says that it is ready."""
    with start(*arguments, cwd=cwd) as process:
        wait_for_line(process, ready)
        yield process
        process.kill()


def learning(endpoint: str, cwd: Path) -> Any:
    arguments = ("learn", "--connect", endpoint, "--out", "c.npz", "--seed", 5, "--json")
    return running(*arguments, ready="waits for a replay", cwd=cwd)


def recording(endpoint: str, cwd: Path) -> Any:
    arguments = ("record", "--connect", endpoint, "--out", "run.mcap", "--stop-at-stream-end", "--json")
    return running(*arguments, ready="records reenact/**", cwd=cwd)


def replaying(log: Path, endpoint: str, consumer: str) -> tuple[object, ...]:
    return ("replay", log, "--connect", endpoint, "--epochs", EPOCHS, "--await", consumer, "--wait", 60, "--json")


def undergone(
    log: Path, consumer: subprocess.Popen[str], name: str, endpoint: str, cwd: Path, ordeal: Callable[[], None]
) -> dict[str, Any]:
    """Replay to a consumer, let something befall it in the middle, and return what the replay says of it."""
    with start(*replaying(log, endpoint, name), cwd=cwd) as replay:
        wait_for_line(consumer, "takes run")
        ordeal()
        assert consumer.poll() is None
        replayed, complaints = replay.communicate(timeout=120)
    _, said = consumer.communicate(timeout=120)
    assert (replay.returncode, consumer.returncode) == (0, 0), complaints + said
    return dict(json.loads(replayed)["consumers"][name])


def assert_recorded(log: Path, path: Path) -> None:
    """Assert that a recording of the whole replay holds every message of it, in order."""
    recorded = LogReader(path).records(topics={SESSION_PHASE, *(topic.name for topic in LEARNER_TOPICS)})
    assert first_divergence(Replay([log], Schedule(epochs=EPOCHS)).stream(), recorded) is None


@pytest.mark.campaign
@pytest.mark.parametrize("cut_s", [3.0, 15.0])
def test_a_learner_whose_connection_is_cut_loses_nothing(
    log: Path, expected: dict[str, Any], tmp_path: Path, cut_s: float
) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))), Proxy(endpoint) as proxy:
        with learning(proxy.endpoint, tmp_path) as learner:
            proxy.cut_after(MIDDLE)
            assert undergone(log, learner, "learner", endpoint, tmp_path, lambda: cut_off(proxy, cut_s)) == expected


def cut_off(proxy: Proxy, seconds: float) -> None:
    """Leave a connection that is cut in the middle of the stream as it is for so long, and restore it."""
    assert proxy.is_cut.wait(timeout=120)
    carried = proxy.carried
    time.sleep(seconds)  # no event: this is what befalls it
    proxy.restore()
    wait_until(lambda: proxy.carried > carried + 1_000)


@pytest.mark.parametrize("cut_s", CUT_S)
def test_a_replay_whose_connection_is_cut_loses_nothing_for_learner_and_recorder(
    log: Path, expected: dict[str, Any], tmp_path: Path, cut_s: float
) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))), Proxy(endpoint) as proxy:
        with learning(endpoint, tmp_path), recording(endpoint, tmp_path) as recorder:
            proxy.cut_after(MIDDLE)
            both = (*replaying(log, proxy.endpoint, "learner"), "--await", "recorder")
            with start(*both, cwd=tmp_path) as replay:
                cut_off(proxy, cut_s)
                replayed, complaints = replay.communicate(timeout=120)
            assert replay.returncode == 0, complaints
            recorded, _ = recorder.communicate(timeout=120)
    result = json.loads(replayed)
    assert result["consumers"]["learner"] == expected
    counted = json.loads(recorded)
    assert counted["gaps"].keys() <= {LEARNER_OUTPUT}  # said to whoever listens; the learner waits for nobody
    assert counted["broken"] == []
    assert_recorded(log, tmp_path / "run.mcap")


@pytest.mark.campaign
@pytest.mark.parametrize("stall_s", [8.0, 14.0])
@pytest.mark.parametrize("name", ["learner", "recorder"])
def test_a_consumer_that_stalls_loses_nothing(
    log: Path, expected: dict[str, Any], tmp_path: Path, name: str, stall_s: float
) -> None:
    endpoint = free_endpoint()

    def stall() -> None:
        consumer.send_signal(signal.SIGSTOP)
        time.sleep(stall_s)  # no event: this is what befalls it
        consumer.send_signal(signal.SIGCONT)

    with open_session(SessionConfig(listen=(endpoint,))):
        with (learning if name == "learner" else recording)(endpoint, tmp_path) as consumer:
            result = undergone(log, consumer, name, endpoint, tmp_path, stall)
    if name == "learner":
        assert result == expected
    else:
        assert_recorded(log, tmp_path / "run.mcap")


@contextmanager
def collecting(endpoint: str, name: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    arguments = [sys.executable, collector.__file__, endpoint, name, json.dumps(options)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def said(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, _ = process.communicate(timeout=120)
    return dict(json.loads(out))


def collected(log: Path, epochs: int) -> dict[str, Any]:
    return Collector().consume(Replay([log], Schedule(epochs=epochs)).stream())


@pytest.mark.parametrize("epochs", [2, pytest.param(60, marks=pytest.mark.campaign)])
def test_at_a_millisecond_a_message_nothing_is_lost(log: Path, tmp_path: Path, epochs: int) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))), collecting(endpoint, "slow", delay_s=0.001) as consumer:
        arguments = (log, "--epochs", epochs, "--connect", endpoint, "--await", "slow", "--wait", 60, "--json")
        replayed = reenact("replay", *arguments, cwd=tmp_path, timeout_s=250)
        assert replayed.returncode == 0, replayed.stderr
        assert json.loads(replayed.stdout)["consumers"]["slow"] == said(consumer) == collected(log, epochs)


@pytest.mark.parametrize("batch", [1, 64])
def test_a_publisher_that_closes_at_once_after_the_last_message_has_lost_nothing(log: Path, batch: int) -> None:
    endpoint, source = free_endpoint(), Replay([log], Schedule(epochs=1))
    config = SenderConfig(consumers=("slow",), batch_size=batch, wait_s=120.0)
    for _ in range(2):
        with collecting(endpoint, "slow", delay_s=0.0002) as consumer:
            with open_session(SessionConfig(listen=(endpoint,))) as session:
                ZenohTransport(session, config=config).deliver(source.offer(), source.stream)
            assert said(consumer) == collected(log, 1)


def test_a_publisher_that_is_killed_leaves_an_error_that_names_the_gap(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, endpoint = SteppedClock(monkeypatch), free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        Receiver(session) as receiver,
        ThreadPoolExecutor() as pool,
    ):
        served = pool.submit(receiver.serve, Collector())
        with subprocess.Popen(
            command("replay", log, "--connect", endpoint, "--rate", 1, "--wait", 60), cwd=tmp_path
        ) as replay:
            wait_until(lambda: receiver.progress.next > 5)
            replay.kill()
        wait_until(lambda: clock.step() and served.done())
    assert re.search("the sender fell silent .*before message ", str(served.exception()))


def test_a_stream_that_breaks_off_is_never_taken_for_a_whole_one_by_a_recorder(log: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))), recording(endpoint, tmp_path) as recorder:
        endless = ("replay", log, "--connect", endpoint, "--epochs", 100_000, "--await", "recorder", "--wait", 60)
        with start(*endless, cwd=tmp_path) as replay:
            wait_for_line(recorder, "takes run")
            replay.send_signal(signal.SIGTERM)
            replay.communicate(timeout=120)
        out, err = recorder.communicate(timeout=120)
    line = complaint(subprocess.CompletedProcess([], recorder.returncode, out, err.splitlines()[-1]))
    assert "run.mcap: the stream is not all there: the sender gave up at message" in line
    (reason,) = LogReader(tmp_path / "run.mcap").manifest["broken"]
    assert reason.endswith(": terminated")


def test_who_came_first_waits_for_as_long_as_the_sender_waits_for_another(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorders.protocol.questions.ALIVE_S", 0.02)  # far more often than it must
    clock, endpoint, source = SteppedClock(monkeypatch), free_endpoint(), Replay([log], Schedule(epochs=1))
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as elsewhere,
        Receiver(elsewhere, config=ReceiverConfig(name="early", silence_s=SILENCE_S)) as early,
        ThreadPoolExecutor() as pool,
    ):
        first = pool.submit(early.serve, Collector())
        transport = ZenohTransport(session, config=SenderConfig(consumers=("early", "late"), wait_s=120.0))
        sent = pool.submit(transport.deliver, source.offer(), source.stream)
        wait_until(lambda: early.offer is not None)
        clock.pass_with_signs_of_life(early, round(2 * SILENCE_S))  # it would have lost its patience long ago
        with Receiver(elsewhere, config=ReceiverConfig(name="late")) as late:
            second = late.serve(Collector())
            assert sent.result(timeout=120) == {"early": first.result(timeout=120), "late": second}
    assert second == first.result() == collected(log, 1)


def test_a_pause_in_the_stream_is_no_silence(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recorders.protocol.questions.ALIVE_S", 0.02)  # far more often than it must
    clock, endpoint, source = SteppedClock(monkeypatch), free_endpoint(), Replay([log], Schedule(epochs=1))

    def paused(begin: int) -> Iterator[RecordedMessage]:
        for index, message in enumerate(source.stream(begin), begin):
            if index == 100:
                clock.pass_with_signs_of_life(receiver, round(2 * SILENCE_S))
            yield message

    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as elsewhere,
        Receiver(elsewhere, config=ReceiverConfig(silence_s=SILENCE_S)) as receiver,
        ThreadPoolExecutor() as pool,
    ):
        served = pool.submit(receiver.serve, Collector())
        delivered = ZenohTransport(session, config=SenderConfig(wait_s=120.0)).deliver(source.offer(), paused)
        assert delivered["learner"] == served.result(timeout=120) == collected(log, 1)
