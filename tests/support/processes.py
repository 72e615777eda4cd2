"""Runs `reenact` as a user does: in a process of its own, in a folder of its own."""

import ctypes
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "pipeline", *map(str, arguments)]


def reenact(*arguments: object, cwd: Path, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), cwd=cwd, capture_output=True, text=True, timeout=timeout_s, check=False)


class Started(subprocess.Popen[str]):
    """A process that a failing test does not wait for, but ends, having it say where each of its threads stood."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and self.poll() is None:
            self.send_signal(signal.SIGABRT)
            try:
                print(*self.communicate(timeout=10), sep="\n")
            except subprocess.TimeoutExpired:
                self.kill()
        super().__exit__(kind, error, trace)


def start(*arguments: object, cwd: Path) -> subprocess.Popen[str]:
    return Started(
        command(*arguments),
        cwd=cwd,
        env=os.environ | {"PYTHONFAULTHANDLER": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def signal_beside(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """Send a signal to another than the main thread: like one that comes just before a wait, it wakes nobody."""
    threads = (int(path.name) for path in Path(f"/proc/{process.pid}/task").iterdir())
    others = (thread for thread in threads if thread != process.pid)
    assert any(ctypes.CDLL(None).tgkill(process.pid, thread, int(number)) == 0 for thread in others)


def wait_for_line(process: subprocess.Popen[str], text: str) -> str:
    """Read the process's standard error up to a line that holds the text, and return that line."""
    assert process.stderr is not None
    for line in process.stderr:
        if text in line:
            return line
    raise AssertionError(f"the process ended without saying {text!r}")


def complaint(run: subprocess.CompletedProcess[str]) -> str:
    """Return the one line that a failed command says, having checked that it is one and no traceback."""
    lines = run.stderr.strip().splitlines()
    assert run.returncode == 2, run.stderr
    assert len(lines) == 1, run.stderr
    assert lines[0].startswith("reenact: "), run.stderr
    return lines[0]


def zenoh_pools(pid: int) -> set[str]:
    """Return the names of Zenoh's pools in which a process has threads."""
    names = set()
    for path in Path(f"/proc/{pid}/task").glob("*/comm"):
        with suppress(OSError):  # a thread may have ended
            names.add(path.read_text().partition("-")[0].strip())
    return names & {"rx", "tx", "acc", "net", "app"}
