"""The folder of a recording as rosbag2 has it: MCAP files, and `metadata.yaml`, by which `ros2 bag play` finds them."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from recorders.errors import LogError, TakenError
from recorders.files.anonymous_file import write_whole
from recorders.mcap_format.channels import DeclaredChannel
from recorders.reading.bag_metadata import METADATA_FILE
from recorders.reading.reader import LogReader
from recorders.rmw_zenoh.bag_channels import HASH_METADATA, QOS_METADATA
from recorders.text.plain_yaml import to_yaml

_VERSION = 7  # of the metadata, as of Iron; Humble reads it without the hashes, and every later rosbag2 with them


def new_bag_folder(folder: Path) -> Path:
    """Make the folder of a bag, and return the file for its recording.

    Raises
    ------
    TakenError
        If there is a folder of this name that is not empty, or a file.
    LogError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = next(folder.iterdir(), None)
    except FileExistsError as error:
        raise TakenError(f"{folder}: expected a new folder for a bag, found a file") from error
    except OSError as error:
        raise LogError(f"{folder}: cannot be made: {error.strerror or error}") from error
    if taken is not None:
        raise TakenError(f"{folder}: expected a new or empty folder for a bag, found {taken.name} in it")
    return folder / f"{folder.resolve().name}.mcap"


def write_bag_metadata(paths: Sequence[Path]) -> Path:
    """Write `metadata.yaml` beside the finished files of a recording, and return its path.

    Messages without a type are in no topic of it: `ros2 bag play` leaves them out.

    Parameters
    ----------
    paths : sequence of Path
        The files, in order, all in one folder.

    Raises
    ------
    LogError
        If one of them cannot be read, or the metadata cannot be written.
    """
    metadata = paths[0].parent / METADATA_FILE
    content = to_yaml({"rosbag2_bagfile_information": _information(paths)}).encode()
    try:
        write_whole(metadata, content)
    except OSError as error:
        raise LogError(f"{metadata}: cannot be written: {error.strerror or error}") from error
    return metadata


def _information(paths: Sequence[Path]) -> dict[str, Any]:
    files = [_file(path) for path in paths]
    first = min(file["starting_time"]["nanoseconds_since_epoch"] for file in files)
    last = max(file["starting_time"]["nanoseconds_since_epoch"] + file["duration"]["nanoseconds"] for file in files)
    topics = _topics(paths)
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        "relative_file_paths": [path.name for path in paths],
        "duration": {"nanoseconds": last - first},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(topic["message_count"] for topic in topics),
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "files": files,
        "custom_data": {},
    }


def _file(path: Path) -> dict[str, Any]:
    statistics = LogReader(path).statistics
    first, last = (0, 0) if statistics is None else (statistics.message_start_time, statistics.message_end_time)
    return {
        "path": path.name,
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": last - first},
        "message_count": 0 if statistics is None else statistics.message_count,
    }


def _topics(paths: Sequence[Path]) -> list[dict[str, Any]]:
    counts: Counter[str] = Counter()
    channels: dict[str, DeclaredChannel] = {}
    for path in paths:
        reader = LogReader(path)
        counts.update(reader.counts)
        for channel in reader.channels:
            if channel.encoding == "cdr" and channel.type:
                channels.setdefault(channel.topic, channel)
    return [{"topic_metadata": _topic(channel), "message_count": counts[topic]} for topic, channel in channels.items()]


def _topic(channel: DeclaredChannel) -> dict[str, str]:
    metadata = dict(channel.metadata)
    return {
        "name": channel.topic,
        "type": channel.type,
        "serialization_format": channel.encoding,
        "offered_qos_profiles": metadata.get(QOS_METADATA, ""),
        "type_description_hash": metadata.get(HASH_METADATA, ""),
    }
