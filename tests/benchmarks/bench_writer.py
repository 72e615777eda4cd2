"""Messages written a second, beside other writers of MCAP: python tests/benchmarks/bench_writer.py [--messages N].

Small poses on seven topics, written in turn by ours, by the mcap library with LZ4 as ours has it and with its defaults,
and, where they are installed, by small-mcap and foxglove-sdk, in one process. Ratios are of the rounds, each of which
runs them all, and of processor time, threads included. Ours alone hands every 64 messages to the operating system,
syncs every second, and hashes what it writes. Nothing is asserted.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.writing.writer import LogWriter

ROUNDS = 5
TOPICS = [f"/pose/{number}" for number in range(7)]
DATA = encode(PoseStamped(0, np.array([0.3, 0.2, 0.76])))
SCHEMA = schema_text(PoseStamped.TYPE).encode()


def stream(messages: int) -> Iterator[tuple[int, int]]:
    """Yield place of the topic and log time [ns]."""
    return ((index % len(TOPICS), index * 1_000_000) for index in range(messages))


def ours(path: Path, messages: int) -> None:
    """Write as a recorder does."""
    with LogWriter(path, manifest={}, rechunk=False) as log:
        for place, time_ns in stream(messages):
            log.write(TOPICS[place], DATA, log_time_ns=time_ns, type_name=PoseStamped.TYPE)


def ours_copied(path: Path, messages: int) -> None:
    """Write records as they are."""
    with LogWriter(path, manifest={}, rechunk=False) as log:
        for place, time_ns in stream(messages):
            log.copy(RecordedMessage(TOPICS[place], PoseStamped.TYPE, DATA, 7, time_ns))


def theirs(path: Path, messages: int, compression: CompressionType = CompressionType.ZSTD) -> None:
    """Write with the library of MCAP's authors."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile="ros2")
        schema = writer.register_schema(PoseStamped.TYPE, "ros2msg", SCHEMA)
        channels = [writer.register_channel(topic, "cdr", schema) for topic in TOPICS]
        for place, time_ns in stream(messages):
            writer.add_message(channels[place], time_ns, DATA, time_ns)
        writer.finish()


def small(path: Path, messages: int) -> None:
    """Write with small-mcap."""
    from small_mcap import McapWriter

    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        writer.add_schema(1, PoseStamped.TYPE, "ros2msg", SCHEMA)
        for number, topic in enumerate(TOPICS):
            writer.add_channel(number, topic, "cdr", 1)
        for place, time_ns in stream(messages):
            writer.add_message(place, time_ns, DATA, time_ns)
        writer.finish()


def foxglove(path: Path, messages: int) -> None:
    """Write with foxglove-sdk."""
    from foxglove import Channel, Context, Schema, open_mcap

    context = Context()
    with open_mcap(str(path), context=context):
        schema = Schema(name=PoseStamped.TYPE, encoding="ros2msg", data=SCHEMA)
        channels = [Channel(topic, schema=schema, message_encoding="cdr", context=context) for topic in TOPICS]
        for place, time_ns in stream(messages):
            channels[place].log(DATA, log_time=time_ns)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "ours": ours,
    "ours, records": ours_copied,
    "mcap, LZ4": lambda path, messages: theirs(path, messages, CompressionType.LZ4),
    "mcap": theirs,
    **({"small-mcap": small} if find_spec("small_mcap") else {}),
    **({"foxglove-sdk": foxglove} if find_spec("foxglove") else {}),
}


def rates(folder: Path, messages: int) -> dict[str, float]:
    """Return thousand messages a second of processor time for every writer, one after another."""
    found = {}
    for name, write in WRITERS.items():
        path = folder / "log.mcap"
        started = time.process_time()
        write(path, messages)
        found[name] = messages / (time.process_time() - started) / 1e3
        path.unlink()
    return found


def main() -> None:
    """Print the rates and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=200_000)
    messages = parser.parse_args().messages
    with tempfile.TemporaryDirectory() as folder:
        rates(Path(folder), 1000)  # loads everything
        rounds = [rates(Path(folder), messages) for _ in range(ROUNDS)]
    for name in WRITERS:
        found = statistics.median(row[name] for row in rounds)
        ratio = statistics.median(row["ours"] / row[name] for row in rounds)
        print(f"{name:16}{found:10.0f} thousand a second   ours is {ratio:5.2f} times as fast")


if __name__ == "__main__":
    main()
