"""A recorder that was killed starts again by itself; nothing that it had recorded is lost, and every name sorts."""

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh
from processes import complaint, reenact, start, wait_for_line
from typer.testing import CliRunner
from unfinished import so_far

from pipeline.cli import app as cli
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import LEFT_TARGET
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session
from recorders.writing.writer import LogWriter

COUNT = 100


def numbers(path: Path) -> list[int]:
    """Return the numbers of the messages that a log holds, as far as it is whole."""
    return [record.sequence for record in so_far(path)]


def latest(folder: Path, pattern: str) -> Path:
    """Return the file that sorts last; between two parts there is none for a moment."""
    return max(folder.glob(pattern), default=folder / "none")


class Recorder:
    """A recorder that something like systemd starts whenever it ends, and a publisher that goes on all the while."""

    def __init__(self, folder: Path, session: zenoh.Session, endpoint: str, *options: str) -> None:
        self._folder = folder
        self._session = session
        self._command = ("record", *options, "--connect", endpoint)
        self.published = 0

    def life(self, producer: TopicPublisher, number: signal.Signals, part: Callable[[], Path]) -> list[str]:
        """Let it live until it has so many messages, and end it; returns its lines up to the one that it records."""
        with start(*self._command, cwd=self._folder) as process:
            lines = [wait_for_line(process, "")]
            while "records reenact/**" not in lines[-1]:
                lines.append(wait_for_line(process, ""))
            self.await_answer()
            for _ in range(COUNT):
                producer.publish(LEFT_TARGET, PoseStamped(0, [0.0, 0.0, 0.0]), log_time_ns=0)
            self.published += COUNT
            while numbers(part())[-1:] != [self.published - 1]:
                assert process.poll() is None
            process.send_signal(number)
            lines += process.communicate(timeout=120)[1].splitlines()
        assert process.returncode == (-signal.SIGKILL if number == signal.SIGKILL else 0), lines
        return lines

    def await_answer(self) -> None:
        """Wait until it hears this session."""
        while not any(
            reply.ok is not None for reply in self._session.get("reenact/@consumer/recorder/status", timeout=120)
        ):
            time.sleep(0.01)


def test_a_recorder_that_is_killed_records_again_and_again(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, TopicPublisher(session) as producer:
        recorder = Recorder(tmp_path, session, endpoint, "--out", "log.mcap")
        for life in range(2):
            lines = recorder.life(producer, signal.SIGKILL, lambda: tmp_path / "log.mcap.part")
            assert len(lines) == 1 + life
        lines = recorder.life(producer, signal.SIGTERM, lambda: tmp_path / "log.mcap.part")
    assert lines[0] == (
        "log.mcap.part was left by a recording that did not come to its end; it is now log.mcap.part.0002, and "
        "`reenact recover` makes a log of it\n"
    )
    assert lines[-1] == f"{COUNT} messages are recorded in log.mcap"
    found = sorted(tmp_path.iterdir())
    assert [path.name for path in found] == ["log.mcap", "log.mcap.part.0001", "log.mcap.part.0002"]
    assert [number for path in (*found[1:], found[0]) for number in numbers(path)] == list(range(3 * COUNT))
    recovered = CliRunner().invoke(cli.app, ["recover", str(found[1]), "--out", str(tmp_path / "first.mcap")])
    assert recovered.exit_code == 0
    assert numbers(tmp_path / "first.mcap") == list(range(COUNT))


def test_a_recorder_in_parts_that_is_killed_leaves_its_parts_together(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, TopicPublisher(session) as producer:
        recorder = Recorder(tmp_path, session, endpoint, "--out", "log.mcap", "--split", "5KB")
        recorder.life(producer, signal.SIGKILL, lambda: latest(tmp_path, "*.part"))
        killed = sorted(path.name for path in tmp_path.iterdir())
        lines = recorder.life(producer, signal.SIGINT, lambda: latest(tmp_path, "log_2*.part"))
    assert lines[0].startswith(f"{killed[-1]} was left by a recording that did not come to its end, and stays")
    assert lines[-1].startswith(f"{COUNT} messages are recorded in ")
    found = sorted(path.name for path in tmp_path.iterdir())
    assert found[: len(killed)] == killed
    assert [number for name in found for number in numbers(tmp_path / name)] == list(range(2 * COUNT))


def test_a_recorder_without_a_name_says_where_it_is_and_two_are_in_nobodys_way(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, TopicPublisher(session) as producer:
        recorder = Recorder(tmp_path, session, endpoint)
        recorder.life(producer, signal.SIGKILL, lambda: latest(tmp_path, "*.part"))
        lines = recorder.life(producer, signal.SIGINT, lambda: latest(tmp_path, "*.part"))
    left, log = sorted(tmp_path.iterdir())
    assert (left.suffixes, log.suffixes) == ([".mcap", ".part"], [".mcap"])
    assert lines[0].endswith(f"to {log.name}; Ctrl-C ends it\n")
    assert lines[-1] == f"{COUNT} messages are recorded in {log.name}"
    assert numbers(left) + numbers(log) == list(range(2 * COUNT))


def test_what_another_writes_at_this_moment_is_refused(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        log.write(LEFT_TARGET, PoseStamped(0, [0.0, 0.0, 0.0]), log_time_ns=0)
        run = reenact("record", "--out", "log.mcap", "--listen", free_endpoint(), cwd=tmp_path)
        assert "log.mcap.part is being written by another recording: choose another name" in complaint(run)
    assert numbers(tmp_path / "log.mcap") == [0]


def test_recover_says_what_it_sets_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with LogWriter("log.mcap", manifest={}) as log:
        log.write(LEFT_TARGET, PoseStamped(0, [0.0, 0.0, 0.0]), log_time_ns=0)
    Path("out.mcap.part").write_bytes(b"precious")
    run = CliRunner().invoke(cli.app, ["recover", "log.mcap", "--out", "out.mcap"])
    assert run.exit_code == 0
    assert "it is now out.mcap.part.0001" in run.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.mcap", "out.mcap", "out.mcap.part.0001"]
    assert Path("out.mcap.part.0001").read_bytes() == b"precious"
