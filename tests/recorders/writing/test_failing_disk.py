"""A disk that fails at any one call ends a recording with one LogError, and loses nothing that it had taken."""

import errno
import gc
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from io_faults import FailingDisk

from recorders.errors import LogError
from recorders.messages.message_types import String
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

BEFORE, AFTER = 70, 10  # messages that are handed over, and those that come after
CODES = (errno.EIO, errno.ENOSPC, errno.EDQUOT)


def write(log: LogWriter, numbers: range) -> None:
    for number in numbers:
        log.write(SESSION_PHASE, String(str(number)), log_time_ns=number)


def record(folder: Path, taken: list[int], *, overwrite: bool) -> None:
    """Record a log; `taken` comes to hold how many messages the caller may rely on."""
    with LogWriter(folder / "log.mcap", manifest={}, overwrite=overwrite) as log:
        write(log, range(BEFORE))
        log.flush()  # early, so that the log is copied at its end
        taken.append(BEFORE)
        write(log, range(BEFORE, BEFORE + AFTER))
    taken.append(BEFORE + AFTER)


def numbers_in(folder: Path) -> list[int]:
    """Return the messages of the fullest log of a folder."""
    found: list[int] = []
    for path in folder.iterdir():
        read: list[int] = []
        try:
            for message in LogReader(path):
                read.append(message.sequence)  # one by one: the last step may raise
        except LogError:
            pass
        found = max(found, read, key=len)
    return found


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_call_that_fails_is_one_error_of_ours_and_what_was_taken_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, overwrite: bool
) -> None:
    for name in ("LOOK_EVERY_S", "SYNC_EVERY_S"):  # the writer's threads would make calls of their own, at any time
        monkeypatch.setattr(f"recorders.writing.log_file.{name}", 3600.0)
    calls = failed(tmp_path / "none", monkeypatch, -1, overwrite=overwrite)
    assert {"open", "flock", "write", "tell", "fsync", "close"} < set(calls)
    for place in range(len(calls)):
        failed(tmp_path / str(place), monkeypatch, place, overwrite=overwrite)
    gc.collect()  # a file that is left open is a warning, which fails the test


def failed(folder: Path, monkeypatch: pytest.MonkeyPatch, place: int, *, overwrite: bool) -> list[str]:
    """Record on a disk of which one call fails, and check what is there; returns the calls."""
    folder.mkdir()
    code = CODES[place % len(CODES)]
    taken = [0]
    with monkeypatch.context() as patch:
        disk = FailingDisk(patch, place, code)
        try:
            record(folder, taken, overwrite=overwrite)
        except LogError as error:
            assert os.strerror(code) in str(error)  # noqa: PT017  that it raises is no part of the promise
    found = numbers_in(folder)
    assert found == list(range(len(found)))
    assert len(found) >= taken[-1], f"{disk.calls[place]}, call {place}"
    return disk.calls


def test_a_disk_that_changes_what_was_written_is_one_error_and_keeps_the_file(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    with LogWriter(whole, manifest={}, rechunk=False) as log:
        write(log, range(BEFORE))
    size = whole.stat().st_size
    for place in range(0, size, size // 60):
        log = LogWriter(tmp_path / f"{place}.mcap", manifest={})
        write(log, range(BEFORE))
        log.flush()  # early, so that the log is copied at its end
        with log.part.open("r+b") as file:
            file.seek(min(place, log.part.stat().st_size - 1))
            (byte,) = file.read(1)
            file.seek(-1, os.SEEK_CUR)
            file.write(bytes([byte ^ 0xFF]))
        with suppress(LogError):  # not all bytes are under a CRC that the library checks
            log.close()
        assert log.part.exists() != log.path.exists()
        if log.path.exists():
            assert [record.sequence for record in LogReader(log.path)] == list(range(BEFORE))


@pytest.mark.parametrize("name", ["log.mcap", "log.mcap.part"])
@pytest.mark.parametrize("target", ["precious", "empty", "none"])
def test_no_link_is_ever_written_through(tmp_path: Path, name: str, target: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "precious").write_bytes(b"precious")
    (tmp_path / "empty").touch()
    link = tmp_path / "folder" / name
    link.symlink_to(tmp_path / target)
    with suppress(LogError), LogWriter(tmp_path / "folder" / "log.mcap", manifest={}, overwrite=True) as log:
        write(log, range(3))
    if name == "log.mcap" and target != "none":
        assert not link.is_symlink()
        assert len(list(LogReader(link))) == 3
    else:
        assert [path.name for path in link.parent.iterdir()] == [name]
        assert link.readlink() == tmp_path / target
    assert (tmp_path / "precious").read_bytes() == b"precious"
    assert (tmp_path / "empty").read_bytes() == b""
    assert not (tmp_path / "none").exists()


def test_a_second_name_of_an_empty_file_is_not_written_to(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "log.mcap.part").hardlink_to(tmp_path / "empty")
    with LogWriter(tmp_path / "log.mcap", manifest={}, overwrite=True) as log:
        write(log, range(3))
    assert (tmp_path / "empty").read_bytes() == b""
    assert len(list(LogReader(log.path))) == 3


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_pipe_in_the_place_of_the_part_is_refused(tmp_path: Path, overwrite: bool) -> None:
    os.mkfifo(tmp_path / "log.mcap.part")
    with pytest.raises(LogError, match=r"log.mcap.part: expected the name of a file, found something else"):
        LogWriter(tmp_path / "log.mcap", manifest={}, overwrite=overwrite)


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        reason = "needs the right to mount a tmpfs"
        pytest.fail(reason) if os.environ.get("REENACT_TEST_EVERYTHING") else pytest.skip(reason)
    yield folder
    subprocess.run(["umount", str(folder)], capture_output=True, check=False)


def test_of_a_mount_that_vanishes_no_path_is_named_that_is_not_there(mounted: Path) -> None:
    (mounted / "folder").mkdir()
    log = LogWriter(mounted / "folder" / "log.mcap", manifest={})
    write(log, range(100))
    subprocess.run(["umount", "--lazy", str(mounted)], check=True)
    with pytest.raises(LogError) as met:
        log.close()
    assert str(met.value) == (
        f"{log.part} was taken away while it was written, with its file system: what was recorded until then is there, "
        "and `reenact recover` saves it once that is mounted again"
    )
