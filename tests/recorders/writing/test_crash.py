"""Recordings that are killed, interrupted or stalled lose 63 messages at most, none of before 100 ms. Also a script.

As a script it records numbered messages in bursts and pauses, and acknowledges each on standard output.
"""

import hashlib
import os
import random
import select
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recorders.errors import LogError
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader
from recorders.writing.chunk_writer import FLUSH_EVERY
from recorders.writing.writer import LogWriter

KILLS = 200
SUBSET = 12
PROMISE_NS = 100_000_000
PATIENCE_S = 120.0
TOPIC = "/numbered"
ACKNOWLEDGEMENT = struct.Struct("<qq")  # number, monotonic time [ns]


def payload(number: int) -> bytes:
    """Return the bytes of a message, which tell its number; some of them are many."""
    return hashlib.sha256(b"%d" % number).digest() * (4_000 if number % 97 == 96 else 1 + number % 40)


class Recording:
    """A child that records to `folder`, until it gets a signal."""

    def __init__(self, folder: Path, *options: object) -> None:
        self._child = subprocess.Popen(
            [sys.executable, __file__, str(folder / "log.mcap"), *map(str, options)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.part = folder / "log.mcap.part"
        self._heard = b""

    def listen(self, seconds: float) -> int:
        """Take acknowledgements for a while; returns the number of bytes that came."""
        assert self._child.stdout is not None
        before = len(self._heard)
        end = time.monotonic() + seconds
        while select.select([self._child.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
            if not (heard := os.read(self._child.stdout.fileno(), 65_536)):
                break
            self._heard += heard
            if time.monotonic() > end:
                break
        return len(self._heard) - before

    def begin(self) -> None:
        """Wait for the first acknowledgement."""
        deadline = time.monotonic() + PATIENCE_S
        while not self.listen(0.01):
            assert time.monotonic() < deadline, "the child records nothing"

    def end(self, number: signal.Signals, *, at_times: bool = False) -> int:
        """Send a signal; returns how many messages must be there.

        They are all but those of an unfinished chunk; by the clock, those that had been acknowledged 100 ms before.
        """
        ended_ns = time.monotonic_ns()
        self._child.send_signal(number)
        with self._child:
            self.listen(PATIENCE_S)
        whole = len(self._heard) // ACKNOWLEDGEMENT.size * ACKNOWLEDGEMENT.size
        acknowledged = list(ACKNOWLEDGEMENT.iter_unpack(self._heard[:whole]))
        before = sum(time_ns <= ended_ns - PROMISE_NS for _, time_ns in acknowledged) if at_times else 0
        return max(before, len(acknowledged) - (FLUSH_EVERY - 1))


def read(path: Path) -> tuple[list[RecordedMessage], LogError | None]:
    """Return the records before the cut, and the error that names it."""
    records: list[RecordedMessage] = []
    try:
        for record in LogReader(path):
            records.append(record)  # one by one: the last step raises
    except LogError as error:
        return records, error
    return records, None


def check(part: Path, *, at_least: int) -> LogError | None:
    records, error = read(part)
    assert [record.sequence for record in records] == list(range(len(records)))
    assert all(record.data == payload(record.sequence) for record in records)
    assert len(records) >= at_least
    return error


def seeds() -> list[object]:
    return [
        pytest.param(seed, marks=() if seed < SUBSET else pytest.mark.campaign, id=str(seed)) for seed in range(KILLS)
    ]


@pytest.mark.parametrize("seed", seeds())
def test_a_killed_recording_has_all_but_its_last_messages(tmp_path: Path, seed: int) -> None:
    """Those of before 100 ms too, which only a machine that is not too busy can keep: that is of the campaign."""
    recording = Recording(tmp_path, "bursts", seed)
    recording.begin()
    recording.listen(random.Random(seed).uniform(0.0, 1.0))
    error = check(recording.part, at_least=recording.end(signal.SIGKILL, at_times=seed >= SUBSET))
    assert "cut off" in str(error)


@pytest.mark.parametrize("seed", range(4))
def test_an_interrupted_recording_has_them_too(tmp_path: Path, seed: int) -> None:
    """Ctrl-C may come in the middle of a write: then the log is not finished, but nothing wrong is in it."""
    recording = Recording(tmp_path, "bursts", seed)
    recording.begin()
    recording.listen(random.Random(seed).uniform(0.0, 0.5))
    error = check(recording.part, at_least=recording.end(signal.SIGINT))
    assert error is not None or LogReader(recording.part).manifest["complete"] is False


@pytest.mark.parametrize("count", [1, 63, 65])
def test_a_stalled_recording_has_everything(tmp_path: Path, count: int) -> None:
    recording = Recording(tmp_path, "stall", count)
    recording.begin()
    deadline = time.monotonic() + PATIENCE_S
    while len(read(recording.part)[0]) < count:
        assert time.monotonic() < deadline, "what waits is not handed over"
        time.sleep(0.01)
    recording.end(signal.SIGKILL)
    check(recording.part, at_least=count)


def record(path: str, kind: str, number: int) -> None:
    draw = random.Random(number)
    with LogWriter(path, manifest={"kind": kind}, rechunk=number % 2 == 0) as log:
        if kind == "stall":
            write(log, range(number))
            time.sleep(PATIENCE_S)
        first = 0
        while True:
            count = draw.choice((1, 3, 40, 300))
            write(log, range(first, first + count))
            first += count
            time.sleep(draw.choice((0.0, 0.002, 0.03, 0.15)))


def write(log: LogWriter, numbers: range) -> None:
    for number in numbers:
        log.write(TOPIC, payload(number), log_time_ns=number, sequence=number, type_name="std_msgs/msg/String")
        os.write(sys.stdout.fileno(), ACKNOWLEDGEMENT.pack(number, time.monotonic_ns()))


if __name__ == "__main__":
    record(sys.argv[1], sys.argv[2], int(sys.argv[3]))
