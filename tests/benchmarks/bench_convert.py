"""Messages a second through `convert`, beside mcap's own: python tests/benchmarks/bench_convert.py [--messages N].

Small poses on seven topics, from MCAP, a rosbag2 folder in sqlite and a ROS 1 bag to MCAP with lz4; mcap's reader and
writer copy the MCAP file, and so does `recover`. Of processor time, in one process; ratios are of the rounds, each of
which runs them all. Ours hashes its sources and the content besides. Nothing is asserted.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from bench_reader import write_ours
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from recorders.conversion.convert import convert
from recorders.messages.message_types import PoseStamped
from recorders.reading.reader import LogReader
from recorders.recovery.recover import recover

ROUNDS = 3


def write_bag(log: Path, bag: Path) -> Path:
    """Write a log of poses as a rosbag2 folder, or as a ROS 1 bag if the path ends so."""
    ros1 = bag.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    header = bytes(4)  # ROS 1 has a number before the stamp, and packs what follows
    with Ros1Writer(bag) if ros1 else BagWriter(bag, version=9) as writer:
        channels = {
            topic: writer.add_connection(topic, PoseStamped.TYPE, typestore=store) for topic in LogReader(log).topics
        }
        for topic, _, data, _, time_ns in LogReader(log):
            body = header + data[4:12] + (5).to_bytes(4, "little") + b"world" + data[-56:] if ros1 else data
            writer.write(channels[topic], time_ns, body)
    return bag


def by_mcap(source: Path, out: Path) -> None:
    with source.open("rb") as read, out.open("wb") as written:
        writer, numbers = Writer(written, compression=CompressionType.LZ4), dict[int, int]()
        writer.start()
        for schema, channel, message in make_reader(read).iter_messages():
            if channel.id not in numbers and schema is not None:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(
                numbers[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


def main(messages: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        out, source = folder / "out.mcap", folder / "log.mcap"
        write_ours(folder / "written.mcap", messages)
        convert([folder / "written.mcap"], source)
        bag, ros1 = write_bag(source, folder / "bag"), write_bag(source, folder / "log.bag")
        ways: dict[str, Callable[[], object]] = {
            "convert MCAP": lambda: convert([source], out, overwrite=True),
            "convert rosbag2 (.db3)": lambda: convert([bag], out, overwrite=True),
            "convert ROS 1 bag": lambda: convert([ros1], out, overwrite=True),
            "recover": lambda: recover(source, out, overwrite=True),
            "mcap reader and writer": lambda: by_mcap(source, out),
        }
        rounds = [{name: rate(run, messages) for name, run in ways.items()} for _ in range(ROUNDS)]
        print(f"{messages} poses, lz4, {ROUNDS} rounds: thousand a second (median), convert MCAP / the other")
        for name in ways:
            ratios = [each["convert MCAP"] / each[name] for each in rounds]
            median = statistics.median(each[name] for each in rounds)
            print(f"  {name:24s} {median:7.0f}   {statistics.median(ratios):5.2f} (least {min(ratios):.2f})")


def rate(run: Callable[[], object], messages: int) -> float:
    begin = time.process_time()
    run()
    return messages / (time.process_time() - begin) / 1000


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=200_000)
    main(parser.parse_args().messages)
