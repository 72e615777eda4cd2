"""What a replay of a huge log keeps in memory: python tests/benchmarks/bench_memory.py [--messages N ...] [--to sink].

`reenact replay LOG --play` of a log with N small messages, in a process of its own, beside the same of a log with one
message (the idle process). Peak of the resident set, as the kernel tells it. By default nobody is awaited; with
`--to sink`, a recorder to a file that nothing is kept of. Nothing is asserted. The default, ten million messages, takes
about 6 minutes. Needs some 30 bytes a message of disk.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import LEFT_TARGET
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

MESSAGES = (10_000_000,)
PERIOD_NS = 1_000_000
POLL_S = 0.1


def write_log(path: Path, messages: int) -> None:
    """Write a log of one topic, by the library's own writer, which is faster than ours by what ours checks."""
    data = encode(PoseStamped(0, np.array([0.3, 0.2, 0.76])))
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="bench_memory")
        schema = writer.register_schema(PoseStamped.TYPE, "ros2msg", schema_text(PoseStamped.TYPE).encode())
        channel = writer.register_channel(LEFT_TARGET, "cdr", schema)
        for index in range(messages):
            stamp = index * PERIOD_NS
            writer.add_message(channel, stamp, data, stamp, index)
        writer.finish()


def peak_mb(arguments: list[str]) -> tuple[float, float]:
    """Run `reenact` and return the peak of its resident set [MB] and the time that it took [s]."""
    begin, peak_kb = time.monotonic(), 0
    with subprocess.Popen([sys.executable, "-m", "pipeline", *arguments], stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            peak_kb = max(peak_kb, _high_water_kb(process.pid))
            time.sleep(POLL_S)
    if process.returncode:
        raise SystemExit(f"reenact {' '.join(arguments)} ended with status {process.returncode}")
    return peak_kb / 1024, time.monotonic() - begin


def _high_water_kb(pid: int) -> int:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0  # it has just ended
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)


def replayed(log: Path, *, to_sink: bool, folder: Path) -> tuple[float, float]:
    """Play a log to nobody, or to a recorder that keeps no topic, through a router in this process."""
    endpoint = free_endpoint()
    arguments = ["replay", str(log), "--play", "--connect", endpoint]
    with open_session(SessionConfig(listen=(endpoint,))):
        if not to_sink:
            return peak_mb(arguments)
        recording = ["record", "--connect", endpoint, "--stop-at-stream-end", "--exclude", "*", "--overwrite", "--out"]
        sink = [sys.executable, "-m", "pipeline", *recording, str(folder / "sink.mcap")]
        with subprocess.Popen(sink, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as recorder:
            try:
                return peak_mb([*arguments, "--await", "recorder"])
            finally:
                recorder.kill()


def main(counts: list[int], *, to_sink: bool) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = folder / "log.mcap"
        write_log(log, 1)
        idle, _ = replayed(log, to_sink=to_sink, folder=folder)
        print(f"{1:>12,d} message   peak {idle:6.0f} MB: the idle process")
        for count in counts:
            begin = time.monotonic()
            write_log(log, count)
            written_s = time.monotonic() - begin
            peak, took_s = replayed(log, to_sink=to_sink, folder=folder)
            size = log.stat().st_size / 1e6
            print(
                f"{count:>12,d} messages  peak {peak:6.0f} MB: {peak - idle:.0f} MB above it"
                f"   (log {size:.0f} MB, written in {written_s:.0f} s, replayed in {took_s:.0f} s)"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, nargs="+", default=MESSAGES)
    parser.add_argument("--to", choices=("nobody", "sink"), default="nobody")
    chosen = parser.parse_args()
    main(list(chosen.messages), to_sink=chosen.to == "sink")
