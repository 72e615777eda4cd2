"""Ctrl-C, SIGTERM and SIGHUP end a verb with a line that says what it leaves behind, and with 128 and their number."""

import fcntl
import os
import pty
import shlex
import signal
import subprocess
import termios
import time
from contextlib import suppress
from pathlib import Path

import pytest
from episodes import write_episode
from processes import command, reenact, signal_beside, start, wait_for_line

from pipeline.cli import app
from pipeline.cli.interrupts import exit_line, note_partial_log
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training import trainer
from pipeline.training.trainer import train
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import LEFT_TARGET
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule

RECORDED = 300_000  # bytes: more than what every log begins with


def last_line(process: subprocess.Popen[str], number: signal.Signals) -> str:
    """End a process by a signal; return its last line, having checked the exit status."""
    process.send_signal(number)
    printed, errors = process.communicate(timeout=120)
    assert process.returncode == 128 + number, errors
    assert printed == ""
    assert "Traceback" not in errors
    return errors.splitlines()[-1]


@pytest.mark.parametrize(
    ("verb", "number", "word"),
    [
        (("explore", "--motion", "eight"), signal.SIGINT, "interrupted"),
        (("demonstrate", "right_hand_house"), signal.SIGTERM, "terminated"),
    ],
)
def test_what_was_recorded_until_then_is_named_and_can_be_recovered(
    tmp_path: Path, verb: tuple[str, ...], number: signal.Signals, word: str
) -> None:
    part = tmp_path / "x.mcap.part"
    with start(*verb, "--out", "x.mcap", cwd=tmp_path) as process:
        until = time.monotonic() + 120
        while not (part.exists() and part.stat().st_size > RECORDED) and time.monotonic() < until:
            assert process.poll() is None
            time.sleep(0.01)
        said = last_line(process, number)
    told, _, command = said.partition(": `")
    assert told == f"reenact: {word}; what was recorded until then is in x.mcap.part"
    run = reenact(*shlex.split(command.removesuffix("`"))[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert sum(LogReader(tmp_path / "recovered_x.mcap").counts.values()) > 0


def test_what_another_left_is_not_claimed(tmp_path: Path) -> None:
    out = tmp_path / "x.mcap"
    (tmp_path / "x.mcap.part").write_bytes(b"of a crash")
    with pytest.raises(KeyboardInterrupt) as stop, note_partial_log(out):
        raise KeyboardInterrupt
    assert exit_line(stop.value) == ("interrupted", 130)


@pytest.mark.parametrize(
    ("number", "word"), [(signal.SIGTERM, "terminated"), (signal.SIGHUP, "its terminal was closed")]
)
def test_a_robot_says_that_it_was_stopped(tmp_path: Path, number: signal.Signals, word: str) -> None:
    with start("robot", "--listen", free_endpoint(), cwd=tmp_path) as process:
        wait_for_line(process, "waits for commands")
        assert last_line(process, number) == f"reenact: {word}"


@pytest.mark.parametrize(
    ("verb", "ready", "status"),
    [(("robot",), "waits for commands", 130), (("record", "--out", "x.mcap"), "records", 0)],
)
def test_what_a_script_starts_in_the_background_is_ended_by_sigint_too(
    tmp_path: Path, verb: tuple[str, ...], ready: str, status: int
) -> None:
    """A shell without job control has SIGINT ignored in what it starts with `&`."""
    line = f"{shlex.join(command(*verb, '--listen', free_endpoint()))} & echo $!; wait $!"
    with subprocess.Popen(
        ["sh", "-c", line], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as shell:
        assert shell.stdout is not None
        background = int(shell.stdout.readline())
        try:
            wait_for_line(shell, ready)
            os.kill(background, signal.SIGINT)
            shell.communicate(timeout=120)
        finally:
            with suppress(ProcessLookupError):
                os.kill(background, signal.SIGKILL)
    assert shell.returncode == status


def ignores(pid: int, number: signal.Signals) -> bool:
    (mask,) = (line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigIgn:"))
    return bool(int(mask.split()[1], 16) >> (number - 1) & 1)


@pytest.mark.parametrize(("verb", "ready"), [(("robot",), "waits for"), (("record", "--out", "x.mcap"), "records")])
def test_under_nohup_a_closed_terminal_ends_nothing(tmp_path: Path, verb: tuple[str, ...], ready: str) -> None:
    with subprocess.Popen(
        ["nohup", *command(*verb, "--listen", free_endpoint())],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        wait_for_line(process, ready)
        assert ignores(process.pid, signal.SIGHUP)
        process.terminate()
        process.communicate(timeout=120)
    assert process.returncode in (0, 143)


def test_a_recorder_whose_terminal_is_closed_finishes_its_log(tmp_path: Path) -> None:
    master, terminal = pty.openpty()
    with subprocess.Popen(
        command("record", "--out", "x.mcap", "--listen", free_endpoint()),
        cwd=tmp_path,
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as process:
        os.close(terminal)
        shown = b""
        while b"Ctrl-C ends it" not in shown:
            shown += os.read(master, 1024)
        os.close(master)
        process.wait(timeout=120)
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]
    assert LogReader(tmp_path / "x.mcap").manifest["complete"] is True


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_a_learner_says_that_there_is_no_controller(tmp_path: Path, number: signal.Signals, word: str) -> None:
    with start("learn", "--out", "c.npz", "--listen", free_endpoint(), cwd=tmp_path) as process:
        wait_for_line(process, "waits for a replay")
        assert last_line(process, number) == f"reenact: {word}; no controller was written"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_training_says_that_there_is_no_controller(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    number: signal.Signals,
    word: str,
) -> None:
    log = write_episode(tmp_path / "log.mcap", samples=4)
    monkeypatch.setattr(trainer.Trainer, "learn", lambda self, replay: signal.raise_signal(number))
    earlier = signal.getsignal(signal.SIGTERM)
    try:
        with pytest.raises(SystemExit) as end:
            app.main(["train", str(log), "--out", str(tmp_path / "c.npz")])
    finally:
        signal.signal(signal.SIGTERM, earlier)
    assert end.value.code == 128 + number
    assert capfd.readouterr().err == f"reenact: {word}; no controller was written\n"
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def waits(process: subprocess.Popen[str]) -> bool:
    """Whether the main thread of a process sleeps just now."""
    return Path(f"/proc/{process.pid}/task/{process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"


@pytest.mark.parametrize(
    ("verb", "ready", "status"),
    [
        ("serve c.npz", "serves", 143),
        ("robot", "waits for commands", 143),
        ("learn --out x.npz", "waits for a replay", 143),
        ("learn --live --robot asimo --out x.npz", "learns asimo", 2),  # as nothing was learned
        ("record --out x.mcap", "records", 0),
        ("replay gap.mcap --play --rate 1", "the stream begins all the same", 143),
    ],
)
def test_a_signal_that_wakes_nobody_ends_them_too(tmp_path: Path, verb: str, ready: str, status: int) -> None:
    log = write_episode(tmp_path / "log.mcap", samples=4)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig(reservoir=20)).controller().save(tmp_path / "c.npz")
    with LogWriter(tmp_path / "gap.mcap", manifest={"kind": "test"}) as writer:
        for second in (0, 1000):
            writer.write(LEFT_TARGET, PoseStamped(second * 10**9, [0.2, 0.2, 0.7]), log_time_ns=second * 10**9)
    with start(*verb.split(), "--listen", free_endpoint(), cwd=tmp_path) as process:
        wait_for_line(process, ready)
        while not waits(process):
            time.sleep(0.01)
        signal_beside(process, signal.SIGTERM)
        _, errors = process.communicate(timeout=120)
    assert process.returncode == status, errors
