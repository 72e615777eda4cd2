"""A replay that obeys the keyboard of its terminal and leaves it as it was; one that is held against a recorded run."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh
from episodes import write_episode
from processes import command
from waiting import wait_until

from pipeline.terminal.replay_controls import VerifiedSource
from recorders.errors import CheckFailed
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET
from recorders.nodes.keys import node_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SAMPLES = 12
DEADLINE_S = 120.0
QUIET_S = 0.6  # three ticks at the recorded pace

FOREGROUND = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
BACKGROUND = """
import fcntl, subprocess, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
sys.exit(subprocess.run(sys.argv[1:], process_group=0, timeout=240).returncode)
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("playing") / "log.mcap", samples=SAMPLES)


class Seated:
    """A paced replay on a terminal of its own, and all that is heard of it."""

    def __init__(
        self, process: subprocess.Popen[bytes], keys: int, terminal: int, session: zenoh.Session, heard: list[str]
    ) -> None:
        self.process = process
        self._session = session
        self._keys = keys
        self._terminal = terminal
        self._heard = heard

    def press(self, key: str) -> None:
        os.write(self._keys, key.encode())

    def count(self) -> int:
        return len(self._heard)

    def wait_for(self, done: Callable[[int], bool]) -> None:
        wait_until(lambda: done(self.count()) or self.process.poll() is not None)
        assert done(self.count())

    def settled(self) -> int:
        """Return how many were heard once every key is read and no more come; fails if they never cease.

        That no more come counts only while the replay runs, as its answers show; each comes behind its messages.
        """
        self.wait_for(lambda count: self._unread() == 0)
        deadline, before = time.monotonic() + DEADLINE_S, -1
        while before != self.count():
            assert time.monotonic() < deadline
            self._await_answer()
            before = self.count()
            time.sleep(QUIET_S)
            self._await_answer()
        return before

    def _await_answer(self) -> None:
        replies = self._session.get(node_key("reenact", "replay", "*", "status"), timeout=DEADLINE_S)
        assert [reply for reply in replies if reply.ok is not None]

    def _unread(self) -> int:
        (count,) = array("i", fcntl.ioctl(self._terminal, termios.FIONREAD, bytes(4)))
        return count

    def status(self) -> int:
        return self.process.wait(timeout=DEADLINE_S)


@contextmanager
def seated(log: Path, *options: object, launcher: str = FOREGROUND) -> Iterator[Seated]:
    """Start a replay on a terminal; whatever becomes of it, the terminal must be as it was in the end."""
    keys, terminal = pty.openpty()
    endpoint, heard = free_endpoint(), list[str]()
    before = termios.tcgetattr(terminal)

    def hear(sample: zenoh.Sample) -> None:
        heard.append(str(sample.key_expr))

    with open_session(SessionConfig(listen=(endpoint,))) as session:
        session.declare_subscriber("reenact/hand/left/target", hear)
        replaying = command("replay", log, "--play", "--topic", LEFT_TARGET, "--connect", endpoint, *options)
        with subprocess.Popen(
            [sys.executable, "-c", launcher, *replaying],
            stdin=terminal,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as process:
            try:
                yield Seated(process, keys, terminal, session, heard)
                assert process.poll() is not None
                assert termios.tcgetattr(terminal) == before
            finally:
                process.kill()
                os.close(keys)
                os.close(terminal)


def test_the_space_bar_stops_a_full_stop_steps_and_ctrl_c_ends_it(log: Path) -> None:
    with seated(log, "--rate", 1, "--loop", 0) as replay:
        replay.wait_for(lambda count: count > 0)
        replay.press(" ")
        stopped = replay.settled()
        for step in (1, 2):
            replay.press(".")
            replay.wait_for(lambda count, expected=stopped + step: count >= expected)  # type: ignore[misc]
            assert replay.settled() == stopped + step
        replay.press(" ")
        replay.wait_for(lambda count: count >= stopped + 5)
        replay.press("\x03")
        assert replay.status() == 130


def test_ctrl_c_ends_a_replay_that_stands_still(log: Path) -> None:
    with seated(log, "--rate", 1, "--loop", 0) as replay:
        replay.wait_for(lambda count: count > 0)
        replay.press(" ")
        replay.settled()
        replay.press("\x03")
        assert replay.status() == 130


def test_the_terminal_is_as_before_after_the_end_and_after_sigterm(log: Path) -> None:
    with seated(log, "--rate", 10) as replay:
        assert replay.status() == 0
        wait_until(lambda: replay.count() >= SAMPLES + 1)  # the last ones are on their way
        assert replay.count() == SAMPLES + 1
    with seated(log, "--rate", 1, "--loop", 0) as replay:
        replay.wait_for(lambda count: count > 0)
        replay.process.send_signal(signal.SIGTERM)
        assert replay.status() == 128 + signal.SIGTERM


def test_in_the_background_it_plays_on_and_lets_the_terminal_be(log: Path) -> None:
    with seated(log, "--rate", 10, launcher=BACKGROUND) as replay:
        replay.press(" ")
        assert replay.status() == 0
        wait_until(lambda: replay.count() >= SAMPLES + 1)  # the last ones are on their way
        assert replay.count() == SAMPLES + 1


Edit = Callable[[list[RecordedMessage], int], list[RecordedMessage]]
EDITS: dict[str, Edit] = {
    "dropped": lambda run, at: run[:at] + run[at + 1 :],
    "repeated": lambda run, at: [*run[:at], run[at], *run[at:]],
    "swapped": lambda run, at: [*run[:at], run[at + 3], *run[at + 1 : at + 3], run[at], *run[at + 4 :]],  # next tick's
}


@pytest.mark.parametrize("everything", [False, True])
@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_a_replay_parts_from_a_run_in_which_a_message_is_out_of_place(
    log: Path, tmp_path: Path, edit: Edit, everything: bool
) -> None:
    replay = Replay([log], Schedule(epochs=1))
    run = list(replay.stream())
    targets = [place for place, record in enumerate(run) if record.topic == LEFT_TARGET]
    at = targets[2 * (SAMPLES + 1) + 5]  # the sixth tick of the third cycle
    with LogWriter(tmp_path / "run.mcap", manifest={}) as writer:
        for record in edit(run, at):
            writer.copy(record)
    passed: list[RecordedMessage] = []
    with pytest.raises(CheckFailed, match=r"^/hand/left/target #5 at 1000000000 ns"):
        passed.extend(VerifiedSource(replay, tmp_path / "run.mcap", everything=everything).stream())
    assert passed == run[: len(passed)]
    assert at - 3 <= len(passed) <= at + 1  # what is yielded runs a tick behind what is compared


def test_a_replay_agrees_with_its_own_run_and_begins_anywhere(log: Path, tmp_path: Path) -> None:
    replay = Replay([log], Schedule(epochs=1))
    run = list(replay.stream())
    with LogWriter(tmp_path / "run.mcap", manifest={}) as writer:
        for record in run:
            writer.copy(record)
    guarded = VerifiedSource(replay, tmp_path / "run.mcap", everything=False)
    assert list(guarded.stream(40)) == run[40:]
    assert guarded.offer() == replay.offer()
