"""A `play` that is killed: nothing of what it started is left behind, and its folder only until the next."""

import signal
import tempfile
from pathlib import Path

from processes import start, wait_for_line
from waiting import wait_until

from pipeline.deployment.session_folder import remove_abandoned


def running() -> dict[int, tuple[int, bytes]]:
    """Return parent and command line of every process that has not ended."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            line, status = (path / "cmdline").read_bytes(), (path / "stat").read_text()
        except OSError:  # it has ended meanwhile
            continue
        if line:
            found[int(path.name)] = int(status.rpartition(")")[2].split()[1]), line
    return found


def children(pid: int) -> set[int]:
    return {child for child, (parent, _) in running().items() if parent == pid}


def test_what_a_killed_play_started_ends_by_itself(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with start("play", "--no-browser", cwd=tmp_path) as play:
        wait_for_line(play, "is at http://127.0.0.1")
        wait_until(lambda: len(children(play.pid)) == 2)  # robot and teacher
        left = {child: running()[child] for child in children(play.pid)}
        play.send_signal(signal.SIGKILL)
        play.wait()
        wait_until(lambda: not any(running().get(child, (0, b""))[1] == line for child, (_, line) in left.items()))
    assert list(tmp_path.glob("reenact-*"))
    remove_abandoned()
    assert not list(tmp_path.glob("reenact-*"))
