"""Undecoded messages a second, beside mcap's own readers: python tests/benchmarks/bench_reader.py [--messages N].

A log of small poses, read in turn by ours and by the two readers of the library in the order of the file, CRCs checked
by all, in one process; the library's once more without. Ratios are of the rounds, each of which runs them all, and of
processor time. Ours yields named tuples with their own bytes. Nothing is asserted.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from bench_memory import write_log
from mcap.reader import NonSeekingReader, make_reader

from recorders.cdr.codec import encode
from recorders.messages.message_types import PoseStamped
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

ROUNDS = 5


def theirs_seeking(log: Path, *, crcs: bool = True) -> int:
    with log.open("rb") as file:
        return count(make_reader(file, validate_crcs=crcs).iter_messages(log_time_order=False))


def theirs_streaming(log: Path, *, crcs: bool = True) -> int:
    with log.open("rb") as file:
        return count(NonSeekingReader(file, validate_crcs=crcs).iter_messages(log_time_order=False))


def count(items: Iterable[object]) -> int:
    return sum(1 for _ in items)


def write_ours(path: Path, messages: int) -> None:
    """Write the same with our writer, on seven topics: it ends a chunk after 64 messages, and indexes each topic."""
    data = encode(PoseStamped(0, np.array([0.3, 0.2, 0.76])))
    with LogWriter(path, manifest={}) as log:
        for index in range(messages):
            log.write(f"/pose/{index % 7}", data, log_time_ns=index * 1_000_000, type_name=PoseStamped.TYPE)


LOGS: dict[str, Callable[[Path, int], None]] = {"chunks of 1 MiB": write_log, "our writer's chunks": write_ours}
READERS: dict[str, Callable[[Path], int]] = {
    "ours": lambda log: count(LogReader(log)),
    "mcap NonSeekingReader": theirs_streaming,
    "mcap NonSeekingReader, no CRCs": lambda log: theirs_streaming(log, crcs=False),
    "mcap make_reader": theirs_seeking,
    "mcap make_reader, no CRCs": lambda log: theirs_seeking(log, crcs=False),
}


def rates(log: Path, messages: int) -> dict[str, float]:
    """Return thousand messages a second of processor time for every reader, one after another."""
    found = {}
    for name, read in READERS.items():
        begin = time.process_time()
        if read(log) != messages:
            raise SystemExit(f"{name}: expected {messages} messages")
        found[name] = messages / (time.process_time() - begin) / 1000
    return found


def main(messages: int) -> None:
    for kind, write in LOGS.items():
        with tempfile.TemporaryDirectory() as name:
            log = Path(name) / "log.mcap"
            write(log, messages)
            rounds = [rates(log, messages) for _ in range(ROUNDS)]
        print(f"{kind}: {messages} poses, lz4, {ROUNDS} rounds: thousand a second (median), ours / theirs")
        for name in READERS:
            ratios = [each["ours"] / each[name] for each in rounds]
            rate = statistics.median(each[name] for each in rounds)
            print(f"  {name:32s} {rate:7.0f}   {statistics.median(ratios):5.2f} (least {min(ratios):.2f})")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=200_000)
    main(parser.parse_args().messages)
