"""The file of a log while it is written: one writer's alone, whole under its name, and never another's."""

import errno
import fcntl
import gc
import io
import os
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from stepped_threads import stepped_threads

from recorders.errors import LogError, TakenError
from recorders.files import disk
from recorders.mcap_format.manifest import content_sha256
from recorders.messages.message_types import String
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.part_file import PartFile, is_written
from recorders.writing.writer import LogWriter


def write(log, count):
    for number in range(count):
        log.write(SESSION_PHASE, String(str(number)), log_time_ns=number)


def fail(*args):
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def error_meanwhile(log):
    """Wait until a thread of the writer has failed, and return what is told of it."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        try:
            log.check()
        except LogError as error:
            return str(error)
        time.sleep(0.02)
    raise AssertionError("nothing failed")


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_log_that_is_being_written_has_one_writer(tmp_path, overwrite):
    path = tmp_path / "log.mcap"
    with LogWriter(path, manifest={}) as log:
        write(log, 5)
        with pytest.raises(LogError, match=r"log.mcap.part is (being written by another|left from an unfinished)"):
            LogWriter(path, manifest={}, overwrite=overwrite)
        write(log, 5)
    assert len(list(LogReader(path))) == 10
    assert list(tmp_path.iterdir()) == [path]


def test_a_log_that_came_into_being_meanwhile_is_not_replaced(tmp_path):
    path = tmp_path / "log.mcap"
    log = LogWriter(path, manifest={})
    write(log, 5)
    path.write_bytes(b"precious")
    with pytest.raises(LogError, match=r"log.mcap has come into being meanwhile: the finished log is .*log.mcap.part$"):
        log.close()
    assert path.read_bytes() == b"precious"
    assert LogReader(log.part).manifest["complete"] is True


def test_a_file_system_without_hard_links_will_do(tmp_path, monkeypatch):
    def no_links(*args):
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "log.mcap"
    with LogWriter(path, manifest={}) as log:
        write(log, 5)
    assert len(list(LogReader(path))) == 5
    path.unlink()
    failing = PartFile(path, overwrite=False)
    with monkeypatch.context() as patch:
        patch.setattr(disk, "rename", fail)
        with pytest.raises(OSError, match="Input/output error"):
            failing.publish()
    assert list(tmp_path.iterdir()) == [failing.part]  # the name is free again
    synced: list[Path] = []
    with monkeypatch.context() as patch:
        patch.setattr(disk, "sync_folder", synced.append)
        failing.publish()
    assert synced == [tmp_path]
    path.unlink()
    late = LogWriter(path, manifest={})
    path.write_bytes(b"precious")
    with pytest.raises(LogError, match="has come into being meanwhile"):
        late.close()
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("waits", [False, True])
def test_a_log_whose_folder_is_removed_is_put_back(tmp_path, waits):
    folder = tmp_path / "folder"
    folder.mkdir()
    log = LogWriter(folder / "log.mcap", manifest={"seed": 3})
    write(log, 100)
    shutil.rmtree(folder)
    expected = r"log.mcap.part was removed while it was written: what had been recorded is there again$"
    if waits:
        assert error_meanwhile(log).endswith("what had been recorded is there again")
        log.close()  # told once
    else:
        with pytest.raises(LogError, match=expected):
            log.close()
    assert list(folder.iterdir()) == [log.part]
    reader = LogReader(log.part)
    assert reader.manifest["messages"] == len(list(reader)) == 100
    assert reader.manifest["complete"] is not waits
    assert reader.manifest["content_sha256"] == content_sha256(reader)


def test_a_log_that_cannot_be_put_back_says_so(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    log = LogWriter(folder / "log.mcap", manifest={})
    write(log, 100)
    shutil.rmtree(folder)
    folder.write_text("a file in the folder's place")
    with pytest.raises(LogError, match=r"removed while it was written, and cannot be put back: Not a directory$"):
        log.close()
    log.close()
    assert folder.read_text() == "a file in the folder's place"


@pytest.fixture
def synced(monkeypatch):
    """What the disk is given: paths, and how long each file then is [bytes]."""
    found: list[tuple[Path, int | None]] = []
    sync = os.fsync

    def watched(descriptor):
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        found.append((path, os.fstat(descriptor).st_size if path.is_file() else None))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    return found


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_has_its_name_once_all_of_it_is_on_the_disk(tmp_path, synced, overwrite):
    file = PartFile(tmp_path / "log.mcap", overwrite=overwrite)
    file.stream.write(b"what was recorded")
    file.publish()
    assert synced == [(tmp_path, None), (file.part, 17), (tmp_path, None)]
    assert (tmp_path / "log.mcap").read_bytes() == b"what was recorded"


def test_a_log_that_cannot_be_read_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "log.mcap"
    path.write_bytes(b"another's")
    monkeypatch.setattr("recorders.writing.part_file.begins_with", fail)
    with pytest.raises(LogError, match=r"cannot write .*log.mcap: Input/output error$"):
        PartFile(path, overwrite=True)
    assert [(entry, entry.read_bytes()) for entry in tmp_path.iterdir()] == [(path, b"another's")]


def test_a_failure_names_the_file_that_is_there(tmp_path):
    file = PartFile(tmp_path / "log.mcap", overwrite=False)
    for _ in range(2):
        assert str(file.failure(OSError(errno.EIO, os.strerror(errno.EIO)))) == (
            f"cannot write {file.part}: Input/output error"
        )
        file.close(keep=True)
    assert str(file.failure(ValueError("it does not read back"))) == f"cannot write {file.part}: it does not read back"


def test_what_is_put_back_is_on_the_disk(tmp_path, synced):
    folder = tmp_path / "folder"
    folder.mkdir()
    file = PartFile(folder / "log.mcap", overwrite=False)
    file.stream.write(b"what was recorded")
    shutil.rmtree(folder)
    synced.clear()
    assert str(file.put_back()).endswith("what had been recorded is there again")
    assert synced == [(tmp_path, None), (file.part, 17), (folder, None)]
    assert file.part.read_bytes() == b"what was recorded"
    file.close(keep=True)
    assert file.stream.closed


def test_a_log_whose_folder_is_moved_is_found_in_its_new_place(tmp_path):
    folder, elsewhere = tmp_path / "folder", tmp_path / "elsewhere"
    folder.mkdir()
    log = LogWriter(folder / "log.mcap", manifest={})
    write(log, 100)
    folder.rename(elsewhere)
    folder.mkdir()
    (folder / "log.mcap.part").write_bytes(b"another's")
    error = error_meanwhile(log)
    assert error.endswith(f"was moved while it was written: the log is {elsewhere / 'log.mcap.part'}")
    with pytest.raises(LogError, match="the log was closed, or an earlier write failed"):
        write(log, 1)
    log.close()
    assert len(list(LogReader(elsewhere / "log.mcap.part"))) == 100
    assert (folder / "log.mcap.part").read_bytes() == b"another's"


def test_without_a_message_nothing_of_anothers_is_removed(tmp_path):
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    log.part.unlink()
    log.part.write_bytes(b"another's")
    log.abort()
    assert log.part.read_bytes() == b"another's"


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_of_anothers_in_the_place_of_the_part_does_not_get_the_name(tmp_path, overwrite):
    with stepped_threads():
        log = LogWriter(tmp_path / "log.mcap", manifest={}, overwrite=overwrite)
        write(log, 5)
        log.part.unlink()
        log.part.write_bytes(b"another's")
        with pytest.raises(LogError, match=r"removed while it was written, and cannot be put back: File exists$"):
            log.close()
    assert [(path, path.read_bytes()) for path in tmp_path.iterdir()] == [(log.part, b"another's")]


@pytest.mark.parametrize("overwrite", [False, True])
def test_what_crashes_left_is_set_aside_in_order_said_and_never_lost(tmp_path, overwrite, caplog):
    path, part = tmp_path / "log.mcap", tmp_path / "log.mcap.part"
    for number in range(12):
        part.write_bytes(b"%d" % number)
        LogWriter(path, manifest={}, overwrite=overwrite).abort()  # it leaves nothing of its own
        if number == 3:
            (tmp_path / "log.mcap.part.0002").unlink()  # its number is not given away again
    kept = [entry.read_bytes() for entry in sorted(tmp_path.iterdir())]
    assert kept == [b"0", *(b"%d" % number for number in range(2, 12))]
    assert caplog.messages[-1] == (
        f"{part} was left by a recording that did not come to its end; it is now {part}.0012, and `reenact recover` "
        "makes a log of it"
    )
    assert len(caplog.messages) == 12


def test_a_second_name_of_a_finished_log_goes_and_is_nobodys_rest(tmp_path, caplog):
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        write(log, 5)
    log.part.hardlink_to(log.path)  # as a crash leaves it, just before it goes
    with LogWriter(tmp_path / "log.mcap", manifest={}, overwrite=True) as other:
        write(other, 3)
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.mcap"]
    assert caplog.messages == []


def test_an_empty_file_that_a_crash_left_goes(tmp_path):
    (tmp_path / "log.mcap.part").touch()
    with LogWriter(tmp_path / "log.mcap", manifest={}):
        pass
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.mcap"]


def test_where_nothing_tells_whether_another_writes_it_is_refused_unless_told(tmp_path, monkeypatch):
    def no_locks(*args):
        raise OSError(errno.ENOLCK, "no locks here")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    part = tmp_path / "log.mcap.part"
    part.write_bytes(b"precious")
    with pytest.raises(LogError, match=r"log.mcap.part is left from an unfinished recording, or another writes it"):
        LogWriter(tmp_path / "log.mcap", manifest={})
    assert part.read_bytes() == b"precious"
    LogWriter(tmp_path / "log.mcap", manifest={}, overwrite=True).close()
    assert (tmp_path / "log.mcap.part.0001").read_bytes() == b"precious"


def seen_while_rewriting(folder):
    """Rewrite a file, and return what stands in its folder meanwhile."""
    file = PartFile(folder / "log.mcap", overwrite=False)
    file.stream.write(b"old")
    seen: list[Any] = []

    def copy(source, target):
        target.write(source.read() + b" and new")
        target.flush()
        seen.extend(entry.name for entry in folder.iterdir())

    old = file.stream
    file.rewrite(copy)
    assert old.closed
    assert is_written(file.part)
    file.publish()
    assert file.stream.closed
    assert not is_written(file.path)
    assert (folder / "log.mcap").read_bytes() == b"old and new"
    return sorted(seen)


def test_a_rewriting_that_is_killed_leaves_nothing_and_no_file_of_anothers_is_touched(tmp_path):
    for name in ("log.mcap.part.tmp", "log.mcap.part.tmp1"):
        (tmp_path / name).write_bytes(b"precious")
    assert seen_while_rewriting(tmp_path) == ["log.mcap.part", "log.mcap.part.tmp", "log.mcap.part.tmp1"]
    assert {entry.name for entry in tmp_path.iterdir()} == {"log.mcap", "log.mcap.part.tmp", "log.mcap.part.tmp1"}
    assert (tmp_path / "log.mcap.part.tmp").read_bytes() == b"precious"
    assert (tmp_path / "log.mcap.part.tmp1").read_bytes() == b"precious"


def test_a_file_system_without_nameless_files_will_do(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "O_TMPFILE", os.O_DIRECTORY)  # as an older file system, which cannot write to a folder
    (tmp_path / "log.mcap.part.tmp1").write_bytes(b"precious")
    assert seen_while_rewriting(tmp_path) == ["log.mcap.part", "log.mcap.part.tmp1", "log.mcap.part.tmp2"]
    assert {entry.name for entry in tmp_path.iterdir()} == {"log.mcap", "log.mcap.part.tmp1"}
    assert (tmp_path / "log.mcap.part.tmp1").read_bytes() == b"precious"


@pytest.mark.parametrize("nameless", [True, False])
def test_a_rewriting_that_fails_leaves_the_file_as_it_was(tmp_path, monkeypatch, nameless):
    if not nameless:
        monkeypatch.setattr(os, "O_TMPFILE", os.O_DIRECTORY)

    def fail(source, target):
        target.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    file = PartFile(tmp_path / "log.mcap", overwrite=False)
    file.stream.write(b"old")
    with pytest.raises(OSError, match="No space left"):
        file.rewrite(fail)
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.mcap.part"]
    assert file.part.read_bytes() == b"old"
    file.close(keep=True)


def test_a_file_that_cannot_be_locked_or_put_on_the_disk_is_not_left(tmp_path, monkeypatch):
    for name in ("lock", "sync_folder"):
        with monkeypatch.context() as patch:
            patch.setattr(disk, name, fail)
            with pytest.raises(LogError, match=r"cannot write .*log.mcap.part: Input/output error"):
                PartFile(tmp_path / "log.mcap", overwrite=False)
        assert list(tmp_path.iterdir()) == []
    gc.collect()  # a file that is left open is a warning, which fails the test


def test_a_file_that_another_has_replaced_before_it_was_locked_stays(tmp_path, monkeypatch):
    part = tmp_path / "log.mcap.part"

    def lock(file):
        part.unlink()
        part.write_bytes(b"another's")
        return True

    monkeypatch.setattr(disk, "lock", lock)
    with pytest.raises(TakenError, match=r"log.mcap.part is being written by another recording"):
        PartFile(tmp_path / "log.mcap", overwrite=False)
    assert part.read_bytes() == b"another's"


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_failure_of_the_disk_after_the_file_has_its_name_is_named_as_such(tmp_path, monkeypatch, overwrite):
    class Failing(io.BufferedWriter):
        def close(self):
            was_open = not self.closed
            super().close()
            if was_open:
                fail()

    path = tmp_path / "log.mcap"
    for name in ("close", "sync_folder"):
        file = PartFile(path, overwrite=overwrite)
        with monkeypatch.context() as patch:
            if name == "close":
                with file.stream as same:
                    file.stream = Failing(io.FileIO(os.dup(same.fileno()), "wb"))
            else:
                patch.setattr(disk, name, fail)
            with pytest.raises(LogError, match=r"log.mcap is whole, but the disk failed after that: Input/output"):
                file.publish()
        assert path.exists()
        file.close(keep=True)
        path.unlink()
