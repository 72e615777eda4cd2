"""The recordings of a conversion: opened as they are, with the channels that remain of them, and their digests."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from recorders.cdr.rosbags_types import is_known, schema_text
from recorders.containers.bag_folder import BagFolder
from recorders.containers.definitions import channel_definitions, ros_name
from recorders.containers.opening import open_as_it_is
from recorders.containers.reader import Opened, Reader
from recorders.conversion.config import ConvertConfig
from recorders.errors import ConfigError, LogError, MessageError
from recorders.files.whole_files import file_sha256
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.messages.topic_patterns import chosen
from recorders.reading.parts import PART, Parts, files_of
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import SessionReader, merged_by_time
from recorders.text.wording import names_text
from recorders.writing.writer import RESERVED

_PROFILES = {"cdr": "ros2", "ros1": "ros1"}


class Sources:
    """Recordings as one stream.

    Parameters
    ----------
    logs : sequence of Path, Parts or Reader
        One or more; a reader's messages may be others than those in its files, such as ticks of them.
    config : ConvertConfig
        What is taken of them.

    Attributes
    ----------
    channels : dict of str to DeclaredChannel
        By topic as recorded, the channel that it becomes.

    Raises
    ------
    LogError
        If there is none, one cannot be read, or a topic is of two types.
    ConfigError
        If two topics would become one.
    """

    def __init__(self, logs: Sequence[Opened], config: ConvertConfig) -> None:
        if not logs:
            raise LogError("expected at least one recording, found none")
        self._config = config
        self.readers = [open_as_it_is(log) if isinstance(log, Path | Parts) else log for log in logs]
        topics = list(dict.fromkeys(topic for reader in self.readers for topic in reader.topics))
        for name in config.renames:
            if name not in topics:
                raise ConfigError(f"--map: no topic {name} in {self.names}; there are: {names_text(topics) or 'none'}")
        self._topics = chosen(config.topics or topics, topics, option="--topic")
        recorded = self._recorded_channels()
        self.channels = {topic: self._channel(topic, recorded[topic]) for topic in topics if topic in self._topics}
        _check_names(self.channels)

    @property
    def names(self) -> str:
        """Names of the recordings, for an error line."""
        return names_text(str(reader.path) for reader in self.readers)

    @property
    def profile(self) -> str:
        """MCAP's name for what the messages are meant for; empty for a mixture."""
        encodings = {channel.encoding for channel in self.channels.values()}
        return next((profile for encoding, profile in _PROFILES.items() if encodings == {encoding}), "")

    def count(self) -> int | None:
        """Return how many messages are taken; None where a slice leaves that open."""
        if self._config.sliced:
            return None
        return sum(count for reader in self.readers for topic, count in reader.counts.items() if topic in self._topics)

    def records(self) -> Generator[RecordedMessage]:
        """Yield what is taken, by log time; each recording keeps the order that its reader gives it.

        Closed, it closes the files that it reads.
        """
        config = self._config
        start_ns, end_ns = 0, FOREVER_NS
        if config.sliced:
            first_ns = min((first for reader in self.readers if (first := _first_ns(reader)) is not None), default=0)
            start_ns = first_ns + config.start_ns
            end_ns = FOREVER_NS if config.end_ns is None else first_ns + config.end_ns
        reads = [
            partial(read, topics=self._topics, start_ns=start_ns, end_ns=end_ns)
            for reader in self.readers
            for read in _reads(reader, sort=config.sort)
        ]
        yield from reads[0]() if len(reads) == 1 else merged_by_time(reads)

    def manifest(self) -> dict[str, Any]:
        """Return the entries on which the manifests of all recordings agree.

        Where topics are left out or have other names, a log of an exploration is a recording like any other.
        """
        first, *others = (
            {key: value for key, value in reader.manifest.items() if key not in (*RESERVED, PART)}
            for reader in self.readers
        )
        found = {key: value for key, value in first.items() if all(other.get(key) == value for other in others)}
        there = {topic: topic for reader in self.readers for topic in reader.topics}
        if "kind" in found and {topic: channel.topic for topic, channel in self.channels.items()} != there:
            found["kind"] = "recording"
        return found

    def digests(self) -> list[dict[str, Any]]:
        """Return name and SHA-256 of each file of each recording."""
        return [
            {
                "name": reader.path.name,
                "files": [{"name": path.name, "sha256": file_sha256(path)} for path in files_of(reader.path)],
            }
            for reader in self.readers
        ]

    def mcap_parts(self) -> list[LogReader]:
        """Return those that are MCAP, part by part: they may have attachments and metadata."""
        parts: list[LogReader] = []
        for reader in self.readers:
            match reader:
                case LogReader():
                    parts.append(reader)
                case SessionReader():
                    parts += reader.parts
        return parts

    def others(self) -> list[Reader]:
        """Return those that are not MCAP as it is."""
        return [reader for reader in self.readers if not isinstance(reader, LogReader | SessionReader)]

    def _recorded_channels(self) -> dict[str, list[tuple[DeclaredChannel, Reader]]]:
        found: dict[str, list[tuple[DeclaredChannel, Reader]]] = {}
        for reader in self.readers:
            for channel in reader.channels:
                found.setdefault(channel.topic, []).append((channel, reader))
        return found

    def _channel(self, topic: str, found: Sequence[tuple[DeclaredChannel, Reader]]) -> DeclaredChannel:
        """Return the one channel that a topic becomes, of all that it was recorded on."""
        defined = [channel for channel, _ in found if channel.schema is not None and channel.schema[2].strip()]
        first = (defined or [channel for channel, _ in found])[0]
        for channel, reader in found:
            if (channel.type, channel.encoding) != (first.type, first.encoding) or not _same_fields(channel, first):
                raise LogError(
                    f"{topic}: expected messages of one type, found {_described(first)} and {_described(channel)} "
                    f"in {reader.path}; leave the topic or a recording out, or convert them one by one"
                )
        return replace(_with_definition(first), topic=self._config.renames.get(topic, topic))


def _reads(reader: Reader, *, sort: bool) -> Sequence[Callable[..., Iterator[RecordedMessage]]]:
    if isinstance(reader, BagFolder):
        return [partial(reader.records, publish_times=True)]
    if not isinstance(reader, LogReader | SessionReader):
        return [reader.records]  # no other container has publish times
    parts = [reader] if isinstance(reader, LogReader) else reader.parts
    reads = [part.by_log_time for part in parts] if sort else [reader.records]
    return [partial(read, publish_times=True) for read in reads]


def _first_ns(reader: Reader) -> int | None:
    """Return the log time of the earliest message [ns]; None if there is no message."""
    if reader.by_file:
        return min((record.log_time_ns for record in reader.records()), default=None)
    first = next(iter(reader.records()), None)
    return None if first is None else first.log_time_ns


def _described(channel: DeclaredChannel) -> str:
    return f"{channel.type or 'no type'} in {channel.encoding or 'no encoding'}"


def _same_fields(channel: DeclaredChannel, other: DeclaredChannel) -> bool:
    """Whether two channels of one type define it alike, or one of them not at all."""
    if channel.schema == other.schema or not (channel.schema and channel.schema[2].strip()):
        return True
    try:
        ours, theirs = (
            {name: fields for name, (_, fields) in channel_definitions(each).items()} for each in (channel, other)
        )
    except MessageError:
        return False
    return ours == theirs


def _with_definition(channel: DeclaredChannel) -> DeclaredChannel:
    """Return a channel with the definition of ROS 2 where its recording carries none, as older bags do."""
    if channel.encoding != "cdr" or channel.schema is None or channel.schema[2].strip():
        return channel
    name = ros_name(channel.type)
    return replace(channel, schema=(name, "ros2msg", schema_text(name).encode())) if is_known(name) else channel


def _check_names(channels: Mapping[str, DeclaredChannel]) -> None:
    by_name: dict[str, str] = {}
    for topic, channel in channels.items():
        other = by_name.setdefault(channel.topic, topic)
        if other != topic:
            raise ConfigError(
                f"expected each topic under a name of its own, found {other} and {topic} both as {channel.topic}; "
                "choose one with --topic, or another name with --map"
            )
