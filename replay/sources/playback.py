"""Plain playback: the messages of some logs in one ordered stream, sliced, renamed, once or again and again."""

import hashlib
import heapq
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count, islice
from operator import attrgetter
from pathlib import Path

from recorders.containers.bag_folder import BagFolder
from recorders.containers.opening import open_log
from recorders.containers.reader import Reader
from recorders.errors import ConfigError, LogError, WireError
from recorders.files.whole_files import file_sha256
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.manifest import content_sha256
from recorders.messages.record import RecordedMessage
from recorders.messages.topic_patterns import chosen
from recorders.messages.topics import CLOCK
from recorders.messages.validation import MAX_STAMP_NS
from recorders.protocol.stream import Offer
from recorders.reading.parts import Log, files_of
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import SessionReader
from recorders.rmw_zenoh.bag_channels import stated_qos
from recorders.rmw_zenoh.qos import Qos
from recorders.text.quantities import MAX_TIME_NS, seconds_text
from recorders.text.wording import names_text
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, message_key
from replay.sources.clock_messages import CLOCK_CHANNEL, with_clock
from replay.sources.latched import EarlyMessages
from replay.sources.scheduled import check_renames, check_size, read_robot


@dataclass(frozen=True)
class PlaybackConfig:
    """The settings of a playback.

    Parameters
    ----------
    topics : frozenset of str
        Patterns of topics to play, such as `/hand/*`, by the names in the logs; all if empty.
    renames : mapping of str to str
        Topic names to use in place of those in the logs; no two may become one.
    start_ns, end_ns : int
        Slice of the recorded time, counted from the earliest message of all logs [ns]; to the end if `end_ns` is None.
    loops : int
        How often to play it all; 0: for ever.
    latched_first : bool
        Whether messages of latched topics that were published before what is played come first, as of its beginning.
    clock_period_ns : int, optional
        Publish the log time on `/clock` at every multiple of this [ns], in place of what was recorded there.
    """

    topics: frozenset[str] = frozenset()
    renames: Mapping[str, str] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int | None = None
    loops: int = 1
    latched_first: bool = False
    clock_period_ns: int | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        if not 0 <= self.start_ns <= MAX_TIME_NS or (self.end_ns is not None and self.end_ns <= self.start_ns):
            raise ConfigError(
                f"slice: expected 0 <= start < end and start up to {seconds_text(MAX_TIME_NS)} s, found {self.span}"
            )
        if self.loops < 0:
            raise ConfigError(f"loops: expected 0 for ever, or a number, found {self.loops}")
        if self.clock_period_ns is not None and self.clock_period_ns < 1:
            raise ConfigError(f"clock: expected a period of 1 ns or more, found {self.clock_period_ns} ns")

    @property
    def sliced(self) -> bool:
        """Whether a part of the recorded time is left out."""
        return self.start_ns > 0 or self.end_ns is not None

    @property
    def changes_messages(self) -> bool:
        """Whether other messages are played than were recorded, or in another order."""
        return self.latched_first or self.clock_period_ns is not None

    @property
    def span(self) -> str:
        """The slice in words."""
        end = "the end" if self.end_ns is None else f"{seconds_text(self.end_ns)} s"
        return f"{seconds_text(self.start_ns)} s to {end}"


class Playback:
    """The stream that logs and a `PlaybackConfig` make.

    Messages of several logs are merged by log time; every log's own order is kept, also where its times fall.

    Raises
    ------
    LogError
        If there is no log, one cannot be read, none has any of the topics, or nothing is to be played.
    ConfigError
        If two topics would be played as one.
    WireError
        If a topic that is played could not be published.
    """

    def __init__(self, paths: Sequence[Log], config: PlaybackConfig | None = None) -> None:
        if not paths:
            raise LogError("expected at least one log, found none")
        self._config = config or PlaybackConfig()
        self._readers = [open_log(path) for path in paths]
        self._played = self._choose()
        self._check_names()
        self._first_ns = self._survey()
        if next(self._once(), None) is None:
            raise LogError(self._nothing_found())

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""
        contents = [_content(reader) for reader in self._readers]
        config = self._config
        what = [contents, sorted(config.topics), sorted(config.renames.items()), config.start_ns, config.end_ns]
        more = [config.latched_first, config.clock_period_ns] if config.changes_messages else []
        return Offer(
            run=hashlib.sha256(json.dumps([*what, config.loops, *more]).encode()).hexdigest()[:32],
            schedule={},
            logs=[
                {"name": reader.path.name, "sha256": digest}
                for reader, digest in zip(self._readers, contents, strict=True)
            ],
            robot=read_robot(self._readers[0]),
            messages=self._count(),
        )

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages from index `start` on."""
        rounds = range(self._config.loops) if self._config.loops else count()
        everything = (message for _ in rounds for message in self._once())
        period_ns = self._config.clock_period_ns
        return islice(everything if period_ns is None else with_clock(everything, period_ns), start, None)

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """The channels of what is played, by the names that it is played under."""
        found = tuple(replace(channel, topic=self._name(channel.topic)) for channel in self._recorded_channels())
        return found if self._config.clock_period_ns is None else (*found, CLOCK_CHANNEL)

    @property
    def qos(self) -> dict[str, Qos]:
        """What is offered on each topic that is played, by the name that it is played under.

        Raises
        ------
        LogError
            If a recording states something else than a quality of service.
        """
        found = {self._name(topic): qos for topic, qos in self._recorded_qos().items()}
        return found if self._config.clock_period_ns is None else {**found, CLOCK: Qos(depth=1)}

    def _name(self, topic: str) -> str:
        """Return the name that a topic of a log is played under."""
        return self._config.renames.get(topic, topic)

    def _recorded_channels(self) -> list[DeclaredChannel]:
        channels = dict.fromkeys(channel for reader in self._readers for channel in reader.channels)
        return [channel for channel in channels if channel.topic in self._played]

    def _recorded_qos(self) -> dict[str, Qos]:
        channels, found = self._recorded_channels(), {}
        for topic in sorted(self._played):
            try:
                found[topic] = stated_qos(channels, topic)
            except WireError as error:
                where = names_text(str(reader.path) for reader in self._readers)
                raise LogError(f"{where}: {topic}: {error}") from error
        return found

    def _once(self) -> Iterator[RecordedMessage]:
        for record in self._recorded():
            topic = self._name(record.topic)
            yield record if topic == record.topic else record._replace(topic=topic)

    def _recorded(self) -> Iterator[RecordedMessage]:
        """Yield what is played, as it was recorded."""
        config = self._config
        begin_ns, end_ns = 0, FOREVER_NS
        if config.sliced:
            begin_ns = self._first_ns + config.start_ns
            end_ns = FOREVER_NS if config.end_ns is None else self._first_ns + config.end_ns
        everything = self._read(self._played, begin_ns, end_ns)
        if not config.latched_first:
            return everything
        depths = {topic: qos.cache_depth for topic, qos in self._recorded_qos().items() if qos.is_latched}
        early = EarlyMessages(depths, max(begin_ns, self._first_ns))
        latched = frozenset(depths)
        return early.first(self._read(latched, 0, begin_ns), self._read(latched, begin_ns, end_ns), everything)

    def _read(self, topics: frozenset[str], start_ns: int, end_ns: int) -> Iterator[RecordedMessage]:
        """Yield the messages of all logs on some topics, by log time."""
        reads = map(_with_publish_times if self._config.latched_first else attrgetter("records"), self._readers)
        logs = (read(topics=topics, start_ns=start_ns, end_ns=end_ns) for read in reads)
        return heapq.merge(*logs, key=lambda record: record.log_time_ns)

    def _survey(self) -> int:
        """Check that all that is played can be, so that nobody learns in the middle that it cannot.

        Returns the log time of the earliest message of all logs [ns], which need not be the first of its file; of those
        that are played, where no slice counts from it.
        """
        first_ns = FOREVER_NS
        for reader in self._readers:
            for record in reader.records(topics=None if self._config.sliced else self._played):
                first_ns = min(first_ns, record.log_time_ns)
                if self._config.clock_period_ns is not None and record.log_time_ns > MAX_STAMP_NS:
                    raise LogError(
                        f"{reader.path}: {record.topic} #{record.sequence}: expected a log time that {CLOCK} can hold, "
                        f"up to {seconds_text(MAX_STAMP_NS)} s, found {seconds_text(record.log_time_ns)} s; play it "
                        "without --clock-rate"
                    )
                if record.topic in self._played:
                    check_size(record, reader.path, hint="; choose the topics that are to be played with --topic")
        return first_ns

    def _nothing_found(self) -> str:
        if not self._config.sliced:
            return f"expected messages in {names_text(str(reader.path) for reader in self._readers)}, found none"
        return (
            f"expected messages in the slice from {self._config.span}, found none; "
            "--start and --end count seconds from the first message of all logs"
        )

    def _count(self) -> int | None:
        """Return how many messages will be played, by the logs' counts; None for a part of them, or for ever."""
        config = self._config
        if config.loops == 0 or config.sliced or config.clock_period_ns is not None:
            return None
        return config.loops * sum(
            count for reader in self._readers for topic, count in reader.counts.items() if topic in self._played
        )

    def _check_names(self) -> None:
        """Check that every topic that is played gets a key, and one of its own."""
        by_key: dict[str, str] = {}
        for topic in sorted(self._played):
            name = self._name(topic)
            other = by_key.setdefault(message_key(DEFAULT_NAMESPACE, name), topic)
            if other != topic:
                raise ConfigError(
                    f"expected each topic under a name of its own, found {other} and {topic} both as {name}; "
                    "choose one with --topic, or another name with --map"
                )

    def _choose(self) -> frozenset[str]:
        """Return the topics that are played, by the names in the logs."""
        found = {topic for reader in self._readers for topic in reader.topics}
        check_renames(self._config.renames, found, where=names_text(str(reader.path) for reader in self._readers))
        played = chosen(self._config.topics or found, found, option="--topic")
        if self._config.clock_period_ns is None:
            return played
        return frozenset(topic for topic in played if self._name(topic) != CLOCK)


def _with_publish_times(reader: Reader) -> Callable[..., Iterator[RecordedMessage]]:
    """Return what reads messages with their publish times, if the container has them."""
    if isinstance(reader, LogReader | SessionReader | BagFolder):
        return partial(reader.records, publish_times=True)
    return reader.records


def _content(reader: Reader) -> str:
    """Return the hash that names a log's content: its own, or that of the file if it has none."""
    if not isinstance(reader.path, Path):
        return content_sha256(reader.records(file_order=True))
    recorded = reader.manifest.get("content_sha256")
    return recorded if isinstance(recorded, str) else file_sha256(*files_of(reader.path))
