"""Messages that `record` takes a second on one processor: python tests/benchmarks/bench_record.py [--rates N ...].

Small poses on seven topics, put at each rate on Zenoh over loopback by this process on one processor; the recorder has
another for itself. What is in the log afterwards is counted. `behind` is how long the recorder still worked on what had
come when the last was put, `processor` what it took of its own: where a machine does other things, that is what counts.
The last line is the highest rate held: nothing lost, and at most 0.25 s behind. Nothing is asserted.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zenoh

from recorders.cdr.codec import encode
from recorders.messages.message_types import PoseStamped
from recorders.nodes.keys import node_key
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

RATES = (5_000, 10_000, 20_000, 25_000, 30_000, 40_000)
SECONDS = 5
BURST_S = 0.005
BEHIND_S = 0.25  # its status is a tenth of a second old at most
TOPICS = 7
PAYLOAD = encode(PoseStamped(0, np.array([0.3, 0.2, 0.76])))
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
PROCESSORS = sorted(os.sched_getaffinity(0))
STATUS = node_key("reenact", "recorder", "recorder", "status")


class Row(NamedTuple):
    """What came of a rate: messages put and found in the log, seconds that putting took, behind, and of processor."""

    put: int
    found: int
    took_s: float
    behind_s: float
    processor_s: float

    @property
    def held(self) -> bool:
        """Whether the recorder kept up and lost nothing."""
        return self.found == self.put and self.behind_s <= BEHIND_S


def processor_s(pid: int) -> float:
    """Return the processor time that a process has taken [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def recorded(session: zenoh.Session) -> int:
    """Return how many messages the recorder has recorded, once it answers."""
    while True:
        for reply in session.get(STATUS, timeout=120):
            if reply.ok is not None:
                return int(json.loads(reply.ok.payload.to_string())["counts"]["messages"])
        time.sleep(0.05)


@contextmanager
def killed(process: subprocess.Popen[str]) -> Iterator[None]:
    """End a process at the end of the block, if it has not ended."""
    try:
        yield
    finally:
        process.kill()


def put_all(session: zenoh.Session, rate: int) -> int:
    """Put messages at a rate for some seconds, in small bursts; return how many."""
    publishers = [
        session.declare_publisher(
            f"reenact/pose/{number}",
            encoding=f"application/cdr;{PoseStamped.TYPE}",
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        for number in range(TOPICS)
    ]
    begin_s, put = time.monotonic(), 0
    while put < rate * SECONDS:
        due = min(int((time.monotonic() - begin_s) * rate), rate * SECONDS)
        for number in range(put, due):
            publishers[number % TOPICS].put(PAYLOAD)
        put = due
        time.sleep(BURST_S)
    return put


def measure(rate: int, folder: Path) -> Row:
    """Record one rate."""
    endpoint, log = free_endpoint(), folder / f"{rate}.mcap"
    command = [sys.executable, "-m", "pipeline", "record", "--out", str(log), "--connect", endpoint, "--json"]
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with (
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as recorder,
            killed(recorder),
        ):
            recorded(session)
            for task in Path(f"/proc/{recorder.pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), {PROCESSORS[-1]})
            before_s, begin_s = processor_s(recorder.pid), time.monotonic()
            put = put_all(session, rate)
            end_s = time.monotonic()
            while recorded(session) < put and time.monotonic() - end_s < SECONDS:
                time.sleep(0.02)
            behind_s, took_s = time.monotonic() - end_s, end_s - begin_s
            used_s = processor_s(recorder.pid) - before_s
            recorder.send_signal(signal.SIGINT)
            recorder.communicate(timeout=120)
    found = sum(LogReader(log).counts.values())
    log.unlink()
    return Row(put, found, took_s, behind_s, used_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=int, nargs="+", default=RATES)
    rates = parser.parse_args().rates
    os.sched_setaffinity(0, {PROCESSORS[0]})
    held = 0
    with tempfile.TemporaryDirectory() as folder:
        measure(1000, Path(folder))  # loads everything
        for rate in rates:
            row = measure(rate, Path(folder))
            held = max(held, rate if row.held else 0)
            print(
                f"{rate:7} a second asked, {row.put / row.took_s:7.0f} put: {row.put - row.found:6} of {row.put} lost, "
                f"behind {row.behind_s:5.2f} s, processor {row.processor_s / row.found * 1e6:4.0f} us a message",
                flush=True,
            )
    print(f"held: {held} a second")


if __name__ == "__main__":
    main()
