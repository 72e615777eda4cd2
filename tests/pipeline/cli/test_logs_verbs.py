"""`info` and `recover` as a user runs them: exit status, JSON, one line for what is no log, files left clean."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import hostile
import pytest
from here import reenact_here
from processes import complaint

from pipeline.cli import app
from pipeline.terminal.log_tables import recovered
from recorders.messages.message_types import Clock
from recorders.messages.topics import CLOCK
from recorders.reading.reader import LogReader
from recorders.recovery.recover import Recovery, _Copy, recover
from recorders.writing.writer import LogWriter

CHUNK = b"\x03\0\0\0lz4"
"""How the data of a chunk begin, after its length."""

_RECORD = f"""
import signal, sys
from recorders.messages.message_types import Clock
from recorders.writing.writer import LogWriter
with LogWriter(sys.argv[1], manifest={{"robot": "asimo"}}) as log:
    for number in range(200):
        log.write({CLOCK!r}, Clock(number), log_time_ns=number)
    log.flush()
    print("written", flush=True)
    signal.pause()
"""


def write(path: Path, count: int = 200) -> Path:
    with LogWriter(path, manifest={"robot": "asimo"}, attachments={"robot.urdf": b"<robot/>"}) as log:
        for number in range(count):
            log.write(CLOCK, Clock(number), log_time_ns=number * 10**9)
    return path


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """A log with damage in its second chunk."""
    raw = bytearray(write(tmp_path / "damaged.mcap").read_bytes())
    second = raw.index(CHUNK, raw.index(CHUNK) + 1)
    raw[second + 100] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(raw)
    return tmp_path / "damaged.mcap"


def test_info_of_a_sound_log(tmp_path: Path) -> None:
    log = write(tmp_path / "log.mcap")
    run = reenact_here("info", log, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    for said in ("/clock", "200", "rosgraph_msgs/msg/Clock", "1.00", "asimo", "robot.urdf (8 B)", "finished, complete"):
        assert said in run.stdout
    run = reenact_here("info", log, "--json", cwd=tmp_path)
    said = json.loads(run.stdout)
    assert (run.returncode, said["sound"], said["messages"], said["manifest"]["robot"]) == (0, True, 200, "asimo")


def test_info_of_a_damaged_log_says_what_there_is_and_exits_1(damaged: Path) -> None:
    run = reenact_here("info", damaged, cwd=damaged.parent)
    assert run.returncode == 1, run.stderr
    assert "136" in run.stdout
    assert "the CRC of a chunk does not hold" in run.stdout or "does not decompress" in run.stdout
    assert "63..128" in run.stdout
    assert "Traceback" not in run.stderr


def test_recover_keeps_what_is_whole(damaged: Path) -> None:
    raw = damaged.read_bytes()
    run = reenact_here("recover", damaged, "--out", "good.mcap", "--json", cwd=damaged.parent)
    assert run.returncode == 0, run.stderr
    said = json.loads(run.stdout)
    assert (said["kept"], said["lost"], said["lost_by_topic"], said["complete"]) == (136, 64, {CLOCK: 64}, False)
    good = damaged.parent / "good.mcap"
    assert [record.sequence for record in LogReader(good)] == [*range(64), *range(128, 200)]
    assert damaged.read_bytes() == raw
    assert reenact_here("info", good, cwd=damaged.parent).returncode == 0
    assert "exists" in complaint(reenact_here("recover", damaged, "--out", good, cwd=damaged.parent))
    run = reenact_here("recover", damaged, "--out", good, "--overwrite", cwd=damaged.parent)
    assert run.returncode == 0, run.stderr
    assert re.search(r"^recovered +136 messages$", run.stdout, re.MULTILINE)
    assert "64 messages (/clock 64)" in run.stdout


def test_one_message_is_one(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", 1)
    lines = recovered(recover(tmp_path / "log.mcap", tmp_path / "good.mcap"))
    assert (lines["recovered"], lines["lost"]) == ("1 message", "0 messages")


def test_a_killed_recording_is_recovered(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _RECORD, str(tmp_path / "log.mcap")], stdout=subprocess.PIPE, text=True
    ) as recording:
        assert recording.stdout is not None
        assert recording.stdout.readline() == "written\n"
        recording.kill()
    run = reenact_here("info", "log.mcap.part", "--json", cwd=tmp_path)
    said = json.loads(run.stdout)
    assert (run.returncode, said["finished"], said["complete"], said["messages"]) == (1, False, False, 200)
    run = reenact_here("recover", "log.mcap.part", "--out", "good.mcap", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    reader = LogReader(tmp_path / "good.mcap")
    assert [record.sequence for record in reader] == list(range(200))
    assert (reader.manifest["robot"], reader.manifest["complete"]) == ("asimo", False)
    assert reader.manifest["recovered"]["from"] == "log.mcap.part"


@pytest.mark.parametrize("verb", [("info",), ("recover", "--out", "good.mcap")])
@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 no log at all, but long enough to be one"])
def test_what_is_no_log_is_one_line(tmp_path: Path, verb: tuple[str, ...], content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "x.mcap").write_bytes(content)
    said = complaint(reenact_here(verb[0], "x.mcap", *verb[1:], cwd=tmp_path))
    assert "x.mcap" in said
    assert not list(tmp_path.glob("good*"))


def test_nothing_in_a_log_reaches_the_terminal_raw(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap", manifest={"kind": "\x1b[31mred\x07", "[bold]": "[/nothing]"}) as log:
        log.write("/\x1b]0;title\x07[red]", b"x", log_time_ns=1, opaque=True)
    run = reenact_here("info", "x.mcap", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "\x1b" not in run.stdout
    assert "\x07" not in run.stdout
    assert "[red]" in run.stdout
    assert "[/nothing]" in run.stdout


def test_the_name_of_a_refused_file_commands_no_terminal(tmp_path: Path) -> None:
    (tmp_path / "a\x1b[31m.mcap").write_bytes(b"no log at all")
    said = complaint(reenact_here("info", "a\x1b[31m.mcap", cwd=tmp_path))
    assert "\x1b" not in said
    assert r"a\x1b[31m.mcap" in said


def test_ctrl_c_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    log, part, copy = write(tmp_path / "log.mcap"), tmp_path / "good.mcap.part", _Copy.run

    def interrupted(*arguments: Any) -> Recovery:
        recovery = copy(*arguments)
        assert part.exists()
        signal.raise_signal(signal.SIGINT)
        return recovery

    monkeypatch.setattr(_Copy, "run", interrupted)
    earlier = signal.getsignal(signal.SIGTERM)
    try:
        with pytest.raises(SystemExit) as end:
            app.main(["recover", str(log), "--out", str(tmp_path / "good.mcap")])
    finally:
        signal.signal(signal.SIGTERM, earlier)
    assert end.value.code == 130
    assert "Traceback" not in capfd.readouterr().err
    assert not list(tmp_path.glob("good*"))


_WITH_LITTLE_MEMORY = """
import resource, sys
from pathlib import Path
import recorders.recovery.session_info, pipeline.cli.logs.diff_files, pipeline.terminal.log_tables
from pipeline.cli.app import main
pages = int(Path("/proc/self/statm").read_text().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 30_000_000,) * 2)
main(sys.argv[1:])
"""


def test_no_memory_left_is_one_line(tmp_path: Path) -> None:
    large = [hostile.channel(1, "/large"), *hostile.bare_message(1, 10**8)]
    log = hostile.log(tmp_path / "log.mcap", large)
    run = subprocess.run(
        [sys.executable, "-c", _WITH_LITTLE_MEMORY, "diff", str(log), str(log)], capture_output=True, text=True
    )
    assert run.returncode == 2
    assert run.stderr.splitlines() == [
        "reenact: there is not enough memory for this; close other programs, or take a smaller input"
    ]


def test_reading_comparing_and_replaying_logs_loads_nothing_that_learns_or_moves_a_robot(tmp_path: Path) -> None:
    program = """
import sys
from contextlib import suppress
from pipeline.cli import app
import pipeline.learner_node.replay_node
for verb in "info", "diff":
    with suppress(SystemExit):
        app.main([verb, *["log.mcap"] * (1 + (verb == "diff"))])
print(sorted({"numba", "pinocchio", "pydrake", "scipy"} & set(sys.modules)), "numpy" in sys.modules)
"""
    write(tmp_path / "log.mcap")
    run = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[] True", run.stdout
