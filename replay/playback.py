"""Plain playback: the messages of some logs in one ordered stream, sliced, renamed, once or again and again."""

import hashlib
import heapq
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, islice, takewhile
from pathlib import Path

from recorders.errors import ConfigError, LogError
from recorders.reader import LogReader
from recorders.records import Stamped
from recorders.stream import Offer
from replay.engine import read_robot

_NS_PER_S = 1e9


@dataclass(frozen=True)
class PlaybackConfig:
    """What is played.

    Parameters
    ----------
    topics : frozenset of str
        Topics to play, by the names in the logs; all if empty.
    renames : mapping of str to str
        Topic names to use in place of those in the logs.
    start_s, end_s : float
        Slice of the recorded time, counted from the first message of all logs [s].
    loops : int
        How often to play it all; 0: for ever.
    """

    topics: frozenset[str] = frozenset()
    renames: Mapping[str, str] = field(default_factory=dict)
    start_s: float = 0.0
    end_s: float = float("inf")
    loops: int = 1

    def __post_init__(self) -> None:
        """Check ranges."""
        if not 0.0 <= self.start_s < self.end_s:
            raise ConfigError(f"slice: expected 0 <= start < end, found {self.start_s:g} to {self.end_s:g} s")
        if self.loops < 0:
            raise ConfigError(f"loops: expected 0 for ever, or a number, found {self.loops}")


class Playback:
    """The stream that logs and a `PlaybackConfig` make.

    Messages of several logs are merged by log time. Every log's own order is kept.

    Raises
    ------
    LogError
        If there is no log, one cannot be read, or none has any of the topics.
    """

    def __init__(self, paths: Sequence[Path], config: PlaybackConfig | None = None) -> None:
        if not paths:
            raise LogError("expected at least one log, found none")
        self._config = config or PlaybackConfig()
        self._readers = [LogReader(path) for path in paths]
        self._check_topics()
        self._first_ns = min(
            (record.log_time_ns for reader in self._readers for record in islice(reader.records(), 1)), default=0
        )

    def offer(self) -> Offer:
        """Return what the consumers are told before the first message."""
        contents = [_content(reader) for reader in self._readers]
        config = self._config
        what = [contents, sorted(config.topics), sorted(config.renames.items()), config.start_s, str(config.end_s)]
        return Offer(
            run=hashlib.sha256(json.dumps([*what, config.loops]).encode()).hexdigest()[:32],
            schedule={},
            logs=[
                {"name": reader.path.name, "sha256": digest}
                for reader, digest in zip(self._readers, contents, strict=True)
            ],
            robot=read_robot(self._readers[0]),
        )

    def stream(self, start: int = 0) -> Iterator[Stamped]:
        """Yield the messages from index `start` on."""
        rounds = range(self._config.loops) if self._config.loops else count()
        return islice((message for _ in rounds for message in self._once()), start, None)

    def _once(self) -> Iterator[Stamped]:
        begin_ns = math.ceil(self._first_ns + self._config.start_s * _NS_PER_S)
        end_ns = self._first_ns + self._config.end_s * _NS_PER_S
        logs = (reader.records(topics=self._config.topics or None, start_ns=begin_ns) for reader in self._readers)
        merged = heapq.merge(*logs, key=lambda record: record.log_time_ns)
        for record in takewhile(lambda record: record.log_time_ns < end_ns, merged):
            topic = self._config.renames.get(record.topic, record.topic)
            yield record if topic == record.topic else record._replace(topic=topic)

    def _check_topics(self) -> None:
        found = {topic for reader in self._readers for topic in reader.topics}
        unknown = sorted((self._config.topics | self._config.renames.keys()) - found)
        if unknown:
            raise LogError(
                f"no topic {', '.join(unknown)} in the logs; there are: {', '.join(sorted(found)) or 'none'}"
            )


def _content(reader: LogReader) -> str:
    """Return the hash that names a log's content: its own, or that of the file if it has none."""
    recorded = reader.manifest.get("content_sha256")
    if isinstance(recorded, str):
        return recorded
    with reader.path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
