"""Messages aligned a second, and the memory that takes: python tests/benchmarks/bench_alignment.py [--memory N ...].

Joints and two tracked hands at rates and stamps of their own, in a log that is not ours, become ticks of 50 Hz, as for
`reenact train`. Reading, decoding and interpolating count, in processor time. With `--memory`, logs of so many messages
beside one of a tenth, each aligned in a process of its own: the peak of its resident set, as the kernel tells it. Ten
million messages need 0.6 GB of disk. Nothing is asserted.
"""

import argparse
import heapq
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path

import numpy as np

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.robot.config import load_robot
from recorders.cdr.codec import encode
from recorders.containers.opening import open_log
from recorders.messages.message_types import JointState, PoseStamped, TypedMessage
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.writing.writer import LogWriter

ROUNDS = 5
START_NS = 1_764_000_000 * 10**9
PERIOD_NS = 20_000_000
HANDS = ("/hand/left/measured", "/hand/right/measured")
RATES = {SAMPLE_JOINTS: 250, HANDS[0]: 120, HANDS[1]: 90}  # [Hz]
STAMP = struct.Struct("<iI")
STAMP_AT = 4  # behind the four bytes that every message in CDR begins with


def stamps(topic: str) -> Iterator[tuple[int, str]]:
    """Yield stamps [ns] of a topic without end, none of them those of another."""
    offset = list(RATES).index(topic) * 1_234_567
    return ((START_NS + offset + index * 10**9 // RATES[topic], topic) for index in count())


def write_log(path: Path, messages: int) -> None:
    """Write what a lab records."""
    robot = load_robot("asimo")
    samples: dict[str, list[TypedMessage]] = {
        SAMPLE_JOINTS: [
            JointState(0, robot.joints, robot.comfort + 0.1 * np.sin(phase + np.arange(len(robot.joints))))
            for phase in np.arange(0.0, 6.3, 0.1)
        ]
    }
    for hand, centre in zip(HANDS, robot.centres, strict=True):
        samples[hand] = [
            PoseStamped(0, centre + 0.05 * np.sin(phase + np.arange(3.0))) for phase in np.arange(0.0, 6.3, 0.1)
        ]
    encoded = {topic: [encode(message) for message in found] for topic, found in samples.items()}
    types = {topic: found[0].TYPE for topic, found in samples.items()}
    with LogWriter(path, manifest={"kind": "recording"}, rechunk=False) as log:
        for index, (stamp, topic) in enumerate(islice(heapq.merge(*map(stamps, RATES)), messages)):
            data = encoded[topic][index % 63]
            data = data[:STAMP_AT] + STAMP.pack(*divmod(stamp, 10**9)) + data[STAMP_AT + STAMP.size :]
            log.write(topic, data, log_time_ns=stamp, type_name=types[topic])


def align(path: Path) -> dict[str, float]:
    """Return how many messages a log has, how many ticks it makes, and the processor time that this takes [s]."""
    config, robot = AlignmentConfig(period_ns=PERIOD_NS), load_robot("asimo")
    begin_s = time.process_time()
    log = AlignedLog(open_log(path), robot, config=config, renames={}, wanted=(*HANDS, SAMPLE_JOINTS))
    seconds = time.process_time() - begin_s
    return {"messages": sum(open_log(path).counts.values()), "ticks": log.counts[SAMPLE_JOINTS], "seconds": seconds}


def align_alone(path: Path) -> dict[str, float]:
    """Return the same of a process of its own, and the peak of its resident set [MB]."""
    done = subprocess.run([sys.executable, __file__, "--align", str(path)], check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout))


def peak_mb() -> float:
    """Return the peak of this process's resident set [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=300_000)
    parser.add_argument("--memory", type=int, nargs="*", default=[])
    parser.add_argument("--align", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.align:
        print(json.dumps(align(options.align) | {"peak_mb": peak_mb()}))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        write_log(path, options.messages)
        align(path)  # compiles everything
        found = min((align(path) for _ in range(ROUNDS)), key=lambda row: row["seconds"])
        rate = found["messages"] / found["seconds"] / 1e3
        print(f"{rate:6.0f} thousand messages a second ({found['messages']} messages, {found['ticks']} ticks)")
        for messages in (size for most in options.memory for size in (most // 10, most)):
            path.unlink()
            write_log(path, messages)
            row, size = align_alone(path), path.stat().st_size / 1e6
            print(
                f"{row['messages']:10.0f} messages in {size:6.0f} MB, {row['ticks']:8.0f} ticks: "
                f"peak {row['peak_mb']:5.0f} MB, {row['messages'] / row['seconds'] / 1e3:4.0f} thousand a second",
                flush=True,
            )


if __name__ == "__main__":
    main()
