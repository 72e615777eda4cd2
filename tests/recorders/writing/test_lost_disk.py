"""A disk that fills up, a folder that vanishes, Ctrl-C: one clear line, and what was written is readable."""

import os
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import zenoh
from processes import command, complaint, wait_for_line
from waiting import wait_for_subscriber

from recorders.errors import LogError
from recorders.messages.message_types import Float64MultiArray, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session
from recorders.writing.writer import LogWriter

PATIENCE_S = 120.0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 128 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        reason = "needs the right to mount a tmpfs"
        pytest.fail(reason) if os.environ.get("REENACT_TEST_EVERYTHING") else pytest.skip(reason)
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def readable(part: Path) -> list[RecordedMessage]:
    """Return what a log holds before it breaks off."""
    records: list[RecordedMessage] = []
    try:
        for record in LogReader(part):
            records.append(record)  # one by one: the last step raises
    except LogError as error:
        assert "cut off" in str(error)  # noqa: PT017  that it raises is no part of the promise
    return records


def test_a_full_disk_ends_a_recording_with_one_error(small_disk: Path) -> None:
    draw = np.random.default_rng(0)

    def record() -> None:
        with LogWriter(small_disk / "log.mcap", manifest={}) as log:
            for tick in range(10_000):
                log.write(LEFT_TARGET, PoseStamped(tick, draw.random(3)), log_time_ns=tick)

    with pytest.raises(LogError, match=r"^cannot write .*log.mcap.part: No space left on device$"):
        record()
    assert [file.name for file in small_disk.iterdir()] == ["log.mcap.part"]
    records = readable(small_disk / "log.mcap.part")
    assert [record.sequence for record in records] == list(range(len(records)))
    assert len(records) > 500


def test_a_disk_that_is_full_when_messages_stop_is_told_by_the_next_call(small_disk: Path) -> None:
    log = LogWriter(small_disk / "log.mcap", manifest={})
    log.write("/bytes", b"first", log_time_ns=0, opaque=True)
    log.flush()
    with suppress(OSError):  # it ends as full as it can be
        (small_disk / "ballast").write_bytes(bytes(1 << 20))
    log.write("/bytes", os.urandom(50_000), log_time_ns=1, opaque=True)
    deadline = time.monotonic() + PATIENCE_S
    with pytest.raises(LogError, match="No space left on device"):  # noqa: PT012  one of these calls
        while time.monotonic() < deadline:
            log.check()
            time.sleep(0.01)
    log.close()
    assert [record.data for record in readable(log.part)] == [b"first"]


def test_no_room_for_the_regular_copy_leaves_a_whole_log(small_disk: Path) -> None:
    log = LogWriter(small_disk / "log.mcap", manifest={})
    for number in range(2):
        log.write("/bytes", os.urandom(40_000), log_time_ns=number, opaque=True)
        log.flush()
    with pytest.raises(LogError, match="No space left on device"):
        log.close()
    assert [file.name for file in small_disk.iterdir()] == ["log.mcap.part"]
    assert LogReader(log.part).manifest["complete"] is True
    assert len(list(LogReader(log.part))) == 2


@pytest.mark.extra
def test_exploration_on_a_full_disk_ends_with_one_line(small_disk: Path, tmp_path: Path) -> None:
    with explorer(small_disk / "log.mcap", tmp_path) as process:
        printed, complaints = process.communicate(timeout=PATIENCE_S)
    done = subprocess.CompletedProcess(process.args, process.returncode, printed, complaints)
    assert complaint(done).endswith("log.mcap.part: No space left on device")
    assert len(readable(small_disk / "log.mcap.part")) > 100


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.extra
def test_exploration_that_is_stopped_leaves_a_finished_part(
    tmp_path: Path, number: signal.Signals, status: int
) -> None:
    part = tmp_path / "log.mcap.part"
    with explorer(tmp_path / "log.mcap", tmp_path) as process:
        deadline = time.monotonic() + PATIENCE_S
        while not part.exists() or part.stat().st_size < 60_000:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(number)
        _, complaints = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == status
    assert "Traceback" not in complaints
    assert not (tmp_path / "log.mcap").exists()
    assert len(readable(part)) >= 64


@contextmanager
def explorer(log: Path, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Start an exploration of a minute of the robot's time."""
    motion = folder / "line.csv"
    rows = [f"{0.5 * n},0.32,0.2,{0.76 + 0.0005 * n},0.32,-0.2,0.76" for n in range(120)]
    motion.write_text("\n".join(["t,lx,ly,lz,rx,ry,rz", *rows, ""]))
    explore = command("explore", "--motion", motion, "--out", log)
    with subprocess.Popen(explore, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def recorder(
    log: Path, before: Callable[[], None] | None = None
) -> Iterator[tuple[zenoh.Session, subprocess.Popen[str]]]:
    """Start a recorder; yields a session that it hears, and its process."""
    endpoint = free_endpoint()
    record = command("record", "--out", log, "--connect", endpoint)
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with subprocess.Popen(
            record, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=before
        ) as process:
            try:
                wait_for_line(process, "records reenact/**")
                wait_for_subscriber(session)
                yield session, process
            finally:
                process.kill()


def complained(process: subprocess.Popen[str]) -> str:
    """Wait for the end of a recorder and return the one line that it says."""
    printed, complaints = process.communicate(timeout=PATIENCE_S)
    return complaint(subprocess.CompletedProcess(process.args, process.returncode, printed, complaints))


def test_a_recorder_whose_file_may_grow_no_more_ends_with_one_line(tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

    draw = np.random.default_rng(0)
    with recorder(tmp_path / "log.mcap", limit) as (session, process):
        with TopicPublisher(session) as producer:
            sent = [
                producer.publish("/my/values", Float64MultiArray(draw.random(50)), log_time_ns=0) for _ in range(300)
            ]
            assert complained(process).endswith("log.mcap.part: File too large")
    records = readable(tmp_path / "log.mcap.part")
    assert len(records) > 50
    assert [record.data for record in records] == [record.data for record in sent[: len(records)]]


def test_a_recorder_whose_folder_is_removed_ends_with_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with recorder(folder / "log.mcap") as (session, process):
        with TopicPublisher(session) as producer:
            sent = [producer.publish(LEFT_TARGET, PoseStamped(n, np.ones(3)), log_time_ns=0) for n in range(100)]
            deadline = time.monotonic() + PATIENCE_S
            while len(readable(folder / "log.mcap.part")) < len(sent):
                assert time.monotonic() < deadline
                time.sleep(0.01)
            shutil.rmtree(folder)
            line = complained(process)
    assert line.endswith("was removed while it was written: what had been recorded is there again")
    reader = LogReader(folder / "log.mcap.part")
    assert [record.data for record in reader] == [record.data for record in sent]
    assert reader.manifest["complete"] is False
