"""What the writer's threads do: late messages are handed over, and equal recordings are equal files nevertheless."""

import errno
import io
import os
import sys
import threading
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from stepped_threads import stepped_threads

from recorders.errors import LogError
from recorders.messages.message_types import String
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.chunk_writer import FLUSH_EVERY, ChunkWriter, rechunk_log
from recorders.writing.log_file import LOOK_EVERY_S, SYNC_EVERY_S, LogFile
from recorders.writing.periodic_thread import PeriodicThread
from recorders.writing.writer import LogWriter


def phases(log, numbers):
    for number in numbers:
        log.write(SESSION_PHASE, String(str(number)), log_time_ns=number)


def handed_over(part):
    """Return how many messages another process would find."""
    found = 0
    try:
        for _ in LogReader(part):
            found += 1
    except LogError:
        pass
    return found


def await_all(log, count):
    deadline = time.monotonic() + 120
    while handed_over(log.part) < count:
        assert time.monotonic() < deadline, "nothing is handed over"
        time.sleep(0.01)


def write(path, *, pauses, rechunk=True):
    with LogWriter(path, manifest={"seed": 3}, attachments={"a.toml": b"a"}, rechunk=rechunk) as log:
        phases(log, range(FLUSH_EVERY - 10))
        if pauses:
            await_all(log, FLUSH_EVERY - 10)
        log.write("/late", b"\x00\x01\x00\x00", log_time_ns=5, type_name="std_msgs/msg/Empty")
        log.write("/raw", b"anything", log_time_ns=5, opaque=True)
        log.note({"run": "a"})
        phases(log, range(5))
        log.attach("b.json", b"{}")
        phases(log, range(3))
        if pauses:
            await_all(log, FLUSH_EVERY)
        phases(log, range(2 * FLUSH_EVERY + 7))
    return path


def test_a_pause_leaves_no_trace_in_the_file(tmp_path):
    paused = write(tmp_path / "paused.mcap", pauses=True)
    assert paused.read_bytes() == write(tmp_path / "straight.mcap", pauses=False).read_bytes()
    live = write(tmp_path / "live.mcap", pauses=True, rechunk=False)
    assert live.read_bytes() != paused.read_bytes()
    assert list(LogReader(live)) == list(LogReader(paused))
    assert LogReader(live).manifest == LogReader(paused).manifest
    assert sorted(file.name for file in tmp_path.iterdir()) == ["live.mcap", "paused.mcap", "straight.mcap"]


def test_a_flush_leaves_no_trace_either(tmp_path):
    for name in ("a.mcap", "b.mcap"):
        with LogWriter(tmp_path / name, manifest={}) as log:
            phases(log, range(10))
            if name == "b.mcap":
                log.flush()
                assert handed_over(log.part) == 10
            phases(log, range(10))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_messages_that_come_while_a_thread_hands_over_are_all_there_once(tmp_path, monkeypatch):
    numbers = range(100 * FLUSH_EVERY + 5)
    with LogWriter(tmp_path / "straight.mcap", manifest={}) as log:
        phases(log, numbers)
    monkeypatch.setattr("recorders.writing.log_file.LOOK_EVERY_S", 0.0)  # the thread does nothing else
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with LogWriter(tmp_path / "live.mcap", manifest={}, rechunk=False) as log:
            phases(log, numbers)
        with LogWriter(tmp_path / "copied.mcap", manifest={}) as log:
            phases(log, numbers)
    finally:
        sys.setswitchinterval(interval)
    with (tmp_path / "live.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 101  # chunks did end early
    assert list(LogReader(tmp_path / "live.mcap")) == list(LogReader(tmp_path / "straight.mcap"))
    assert LogReader(tmp_path / "live.mcap").manifest == LogReader(tmp_path / "straight.mcap").manifest
    assert (tmp_path / "copied.mcap").read_bytes() == (tmp_path / "straight.mcap").read_bytes()


def test_what_a_thread_meets_is_raised_once_by_the_next_call(tmp_path):
    for act in (lambda log: phases(log, [0]), LogWriter.flush, LogWriter.check, LogWriter.close):
        log = _failed(tmp_path)
        with pytest.raises(LogError, match=r"cannot write .*log.mcap.part: Bad file descriptor"):
            act(log)
        if act is not LogWriter.close:
            with pytest.raises(LogError, match="the log was closed, or an earlier write failed"):
                log.flush()
        log.close()
        log.abort()
        log.part.unlink()


def test_a_check_waits_for_a_thread_that_writes(tmp_path, monkeypatch):
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    flush, lock = log._file.chunks.flush, log._file._lock
    writing, asked = threading.Event(), threading.Event()

    class Watched:
        def __enter__(self):
            asked.set()
            lock.acquire()

        def __exit__(self, *error):
            lock.release()

    def slow():  # holds the lock, until the check asks for it
        log._file._lock = Watched()  # type: ignore[assignment]
        writing.set()
        assert asked.wait(120)
        flush()

    monkeypatch.setattr(log._file.chunks, "flush", slow)
    phases(log, [0])
    assert writing.wait(120)
    log.check()
    log.close()
    assert LogReader(log.path).manifest["complete"] is True


def _failed(folder):
    """Return a writer whose file went away under it, once its thread has met that."""
    with stepped_threads() as threads:
        log = LogWriter(folder / "log.mcap", manifest={})
        phases(log, range(10))
        read_only = os.open(os.devnull, os.O_RDONLY)
        os.dup2(read_only, _descriptor(log.part))  # as a file system does that turns read-only
        os.close(read_only)
        for _ in range(2):
            threads.step("log flush")
    assert not log._file.sound
    return log


def _descriptor(path):
    for link in Path("/proc/self/fd").iterdir():
        if link.resolve() == path.resolve():
            return int(link.name)
    raise AssertionError(f"{path} is not open")


def test_the_disk_takes_the_log_every_second_and_at_the_end(tmp_path, monkeypatch):
    synced = []
    sync = os.fsync

    def watched(descriptor):
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    assert synced == [tmp_path]
    deadline = time.monotonic() + 120
    while len(synced) < 3:
        assert time.monotonic() < deadline, "nothing is synced"
        time.sleep(0.01)
    assert set(synced[1:]) == {log.part}
    log.close()
    assert synced[-2:] == [log.part, tmp_path]


def test_no_thread_outlives_its_log(tmp_path):
    before = threading.active_count()
    with LogWriter(tmp_path / "log.mcap", manifest={}):
        assert threading.active_count() == before + 2
    assert threading.active_count() == before
    log = LogWriter(tmp_path / "other.mcap", manifest={})
    log.abort()
    assert threading.active_count() == before
    with pytest.raises(LogError):
        LogWriter(tmp_path / "none" / "log.mcap", manifest={})
    assert threading.active_count() == before


@pytest.mark.parametrize("name", ["log flush", "log sync"])
@pytest.mark.parametrize("runs", [False, True])
def test_a_log_whose_threads_are_cut_short_as_they_start_leaves_nothing(tmp_path, monkeypatch, name, runs):
    start, begun = threading.Thread.start, []

    def cut(thread):
        begun.append(thread)
        if thread.name != name or runs:
            start(thread)
        if thread.name == name:
            raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", cut)
    with pytest.raises(KeyboardInterrupt):
        LogWriter(tmp_path / "log.mcap", manifest={})
    assert [thread.name for thread in begun] == ["log flush", "log sync"][: len(begun)]
    assert begun[-1].name == name
    assert not any(thread.is_alive() for thread in begun)
    assert list(tmp_path.iterdir()) == []


def test_what_is_promised_of_the_time_until_a_message_is_safe():
    assert 2 * LOOK_EVERY_S <= 0.1
    assert SYNC_EVERY_S <= 1.0
    assert FLUSH_EVERY <= 64


def test_what_waits_at_two_looks_is_handed_over_and_nothing_earlier(tmp_path):
    with stepped_threads() as threads, LogWriter(tmp_path / "log.mcap", manifest={}, rechunk=False) as log:
        phases(log, range(3))
        threads.step("log flush")
        assert handed_over(log.part) == 0
        phases(log, range(FLUSH_EVERY))  # those that waited are written, and the last three are others
        threads.step("log flush")
        assert handed_over(log.part) == FLUSH_EVERY
        phases(log, range(1))
        threads.step("log flush")
        assert handed_over(log.part) == FLUSH_EVERY + 4
        threads.step("log flush")
        phases(log, range(1))
        threads.step("log flush")
        assert handed_over(log.part) == FLUSH_EVERY + 4


@pytest.mark.parametrize("act", [LogWriter.close, LogWriter.abort])
def test_a_log_that_is_over_takes_nothing_and_is_not_ended_twice(tmp_path, monkeypatch, act):
    monkeypatch.setattr(os, "O_TMPFILE", os.O_DIRECTORY)  # a file system whose every file has a name
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    phases(log, [0])
    act(log)
    others = [log.part, tmp_path / "log.mcap.part.tmp1"]  # which another writer now has
    for path in others:
        path.write_bytes(b"another's")
    log.abort()
    log.close()
    assert [path.read_bytes() for path in others] == [b"another's"] * 2
    for _ in range(2):
        with pytest.raises(LogError, match="the log was closed, or an earlier write failed"):
            log.check()


def test_one_message_is_worth_keeping(tmp_path):
    log = LogWriter(tmp_path / "log.mcap", manifest={})
    phases(log, [0])
    log.abort()
    assert len(list(LogReader(log.part))) == 1


def test_a_write_that_fails_is_the_last(tmp_path):
    def fail():
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with stepped_threads() as threads:
        file = LogFile(tmp_path / "log.mcap", end=lambda chunks, complete: None, overwrite=False, rechunk=True)
        with pytest.raises(LogError, match=r"cannot write .*log.mcap.part: Input/output error"):
            file.change(fail)
        for name in ("log flush", "log sync"):
            threads.step(name)
        assert not file.sound
        with pytest.raises(LogError, match="the log was closed, or an earlier write failed"):
            file.change(lambda: None)
        file.close()


def test_a_write_that_is_interrupted_is_the_last(tmp_path):
    def interrupted():
        raise KeyboardInterrupt

    with stepped_threads():
        file = LogFile(tmp_path / "log.mcap", end=lambda chunks, complete: None, overwrite=False, rechunk=True)
        with pytest.raises(KeyboardInterrupt):
            file.change(interrupted)
        with pytest.raises(LogError, match="an earlier write was interrupted"):
            file.close()
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_cannot_be_begun_leaves_nothing(tmp_path, monkeypatch):
    def fail(*args, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = threading.active_count()
    for name in ("ChunkWriter.attach", "ChunkIndexFile.__init__"):
        with monkeypatch.context() as patch:
            patch.setattr(f"recorders.writing.chunk_writer.{name}", fail)
            with pytest.raises(LogError, match=r"cannot write .*: No space left on device"):
                LogWriter(tmp_path / "log.mcap", manifest={}, attachments={"a": b"a"})
        assert list(tmp_path.iterdir()) == []
        assert threading.active_count() == before


def test_what_comes_while_the_end_is_written_is_not_written_any_more(tmp_path):
    with (tmp_path / "log.mcap").open("wb") as file:
        chunks = ChunkWriter(file, tmp_path / "log.mcap")
        channel = chunks.register_channel("/x", "", 0, {})
        chunks.flush()
        assert chunks.regular  # nothing ended early
        chunks.gather((channel, 0, 0, 0, b"in time"))
        chunks.end_messages()
        chunks.gather((channel, 1, 0, 0, b"late"))
        chunks.add_metadata("end", {})
        chunks.finish()
        chunks.close()
    with (tmp_path / "log.mcap").open("rb") as file:
        assert [message.data for _, _, message in make_reader(file).iter_messages()] == [b"in time"]


def test_a_copy_blames_the_disk_or_what_was_written(tmp_path):
    class Failing(io.BytesIO):
        def read(self, *args):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    path = tmp_path / "log.mcap"
    LogWriter(path, manifest={}).close()
    for source, error, expected in (
        (Failing(), OSError, "Input/output error"),
        (io.BytesIO(path.read_bytes()[:100]), ValueError, "what was written does not read back"),
        (io.BytesIO(b"anything"), ValueError, "what was written does not read back"),
    ):
        with pytest.raises(error, match=expected):
            rechunk_log(source, io.BytesIO(), path)


def test_a_thread_that_is_stopped_has_done_what_it_was_doing_and_holds_up_nobody_else():
    done: list[bool] = []

    def act():
        started.set()
        assert stopping.wait(120)
        time.sleep(0.05)  # so that whoever does not wait for it is through
        done.append(True)

    started, stopping = threading.Event(), threading.Event()
    thread = PeriodicThread(act, name="slow", every_s=0.0)
    thread.start()
    assert started.wait(120)
    assert thread._thread.daemon  # an interpreter that ends does not wait for it
    stopping.set()
    thread.stop()
    assert done == [True]
