"""Settings of a recorder, and statistics of a recording."""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from recorders.errors import ConfigError
from recorders.messages.topic_patterns import matches
from recorders.recording.publisher_counts import PublisherCounts

_MAX_BROKEN = 100  # anyone may offer a stream and break it off


@dataclass(frozen=True)
class RecordConfig:
    """Topics to record, and how the recording is divided into files.

    Parameters
    ----------
    include, exclude : tuple of str
        Patterns of topics, such as `/hand/*`; everything is included if no pattern is given.
    split_bytes : int, optional
        Begin another file when one has this many bytes of messages.
    split_ns : int, optional
        Begin another file with the first message that comes this long after the first one of a file [ns].
    for_rosbag2 : bool
        Whether every channel has a schema, also one of messages of an unknown type: rosbag2 opens no others.
    use_sim_time : bool
        Whether log times are those at which messages arrived, by `/clock`, and not those of the clock on the wall.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    split_bytes: int | None = None
    split_ns: int | None = None
    for_rosbag2: bool = False
    use_sim_time: bool = False

    def __post_init__(self) -> None:
        """Check ranges."""
        if any(split is not None and split < 1 for split in (self.split_bytes, self.split_ns)):
            raise ConfigError("split: expected a size or a time above 0")

    def wants(self, topic: str) -> bool:
        """Whether a topic is to be recorded."""
        return (not self.include or matches(topic, self.include)) and not matches(topic, self.exclude)


@dataclass
class RecordingStats:
    """Statistics of what has been recorded so far.

    Attributes
    ----------
    paths : list of Path
        Files, in order.
    messages, size : int
        How many messages, and how many bytes of them.
    of_streams : int
        How many of these were of streams that awaited this.
    gaps : counter of str
        Messages that producers numbered and that did not arrive, by topic.
    opaque : counter of str
        Messages that are not of a known ROS 2 type, or do not decode as their declared type, by topic.
    refused : counter of str
        Messages that were not taken at all, by topic and reason: too large, or more than could be kept waiting.
    broken : deque of str
        Why the latest of the streams that awaited this and never came to their end did not.
    left_out : int
        How many messages were on topics that are not to be recorded.
    publishers : PublisherCounts
        Messages that came, and that did not, of each publisher in a ROS domain.
    topics : set of str
        Topics of which messages are recorded.
    silent : list of str
        Topics that had a publisher in a ROS domain, and of which no message came.
    """

    paths: list[Path] = field(default_factory=list)
    messages: int = 0
    size: int = 0
    of_streams: int = 0
    gaps: Counter[str] = field(default_factory=Counter)
    opaque: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    broken: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_BROKEN))
    left_out: int = 0
    publishers: PublisherCounts = field(default_factory=PublisherCounts)
    topics: set[str] = field(default_factory=set)
    silent: list[str] = field(default_factory=list)

    def note_published(self, topics: Iterable[str]) -> None:
        """Note which topics had a publisher: those that are not recorded are silent."""
        self.silent = sorted(set(topics) - self.topics)

    def to_dict(self) -> dict[str, Any]:
        """Return the recording for JSON."""
        return self.totals() | self.publishers.to_dict()

    def totals(self) -> dict[str, Any]:
        """Return the recording for JSON without its publishers, one by one."""
        return {
            "paths": [str(path) for path in self.paths],
            "messages": self.messages,
            "bytes": self.size,
            "of_streams": self.of_streams,
            "gaps": dict(self.gaps),
            "opaque": dict(self.opaque),
            "refused": dict(self.refused),
            "broken": list(self.broken),
            "left_out": self.left_out,
            "silent": self.silent,
        }
