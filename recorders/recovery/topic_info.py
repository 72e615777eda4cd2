"""Summary of one topic of a log: rates, numbers and times that are missing, and how the stamps lie to log time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from recorders.containers.decoding import stamp_reader
from recorders.errors import MessageError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.recovery.clocks import ClockLine
from recorders.recovery.intervals import Intervals, rate_hz
from recorders.recovery.number_series import NumberSeries
from recorders.recovery.salvage import Salvaged


@dataclass(slots=True)
class TopicSummary:
    """The summary of one topic.

    Attributes
    ----------
    topic, type, encoding : str
        As its channel was declared; `type` is the name of the schema.
    count : int
        Number of messages.
    first_ns, last_ns : int
        Log time of the earliest and the latest message [ns].
    numbers : NumberSeries
        Those of its messages by which some are missing.
    numbered : bool
        Whether the messages have numbers of their own: not where all are 0, or where all topics share them.
    log_times, stamps : Intervals
        The steps between log times, and between the producer's stamps.
    ahead_ns : pair of int or None
        The least and the most that a stamp is ahead of log time [ns]; None without stamps.
    clock : ClockLine
        How stamps lie to log time.
    """

    topic: str
    type: str
    encoding: str
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    numbers: NumberSeries = field(default_factory=NumberSeries)
    numbered: bool = False
    log_times: Intervals = field(default_factory=Intervals)
    stamps: Intervals = field(default_factory=Intervals)
    ahead_ns: tuple[int, int] | None = None
    clock: ClockLine = field(default_factory=ClockLine)
    _channel: DeclaredChannel | None = None
    _stamp_of: Callable[[bytes], int | None] = lambda data: None

    @property
    def rate_hz(self) -> float | None:
        """Messages in a second by log time [Hz]; None where too few messages in too short a time show none."""
        return rate_hz(self.count - 1, self.last_ns - self.first_ns)

    @property
    def stamp_rate_hz(self) -> float | None:
        """Messages in a second by the producer's stamps [Hz], over the steps that go forward; None without stamps."""
        return rate_hz(self.stamps.forward, self.stamps.total_ns)

    @property
    def longest_gap_ns(self) -> int | None:
        """The longest time between messages [ns]; None if there are no two, or their log times fall."""
        return self.log_times.longest_ns if self.count > 1 and not self.log_times.falls else None

    @property
    def dropped(self) -> int | None:
        """Messages that an even rate lacks, by stamps where there are any; None if the rate is not even."""
        stamped = self.stamps.count + self.stamps.falls + 1 == self.count
        return (self.stamps if stamped else self.log_times).dropped

    def add(self, message: Salvaged) -> None:
        """Take in a message."""
        time_ns = message.log_time_ns
        self.first_ns = min(self.first_ns, time_ns) if self.count else time_ns
        self.last_ns = max(self.last_ns, time_ns)
        self.count += 1
        self.log_times.add(time_ns)
        self.numbered |= message.sequence > 0
        self.numbers.add(message.channel, message.sequence)
        self._add_stamp(message)

    def take_no_numbers(self) -> None:
        """Forget the numbers of the messages: they are not this topic's own."""
        self.numbers, self.numbered = NumberSeries(), False

    def _add_stamp(self, message: Salvaged) -> None:
        if message.channel is not None and message.channel is not self._channel:
            self._channel, self._stamp_of = message.channel, stamp_reader(message.channel)
        try:
            stamp = self._stamp_of(message.data)
        except MessageError:
            return
        if stamp is None:
            return
        self.stamps.add(stamp)
        ahead = stamp - message.log_time_ns
        least, most = self.ahead_ns or (ahead, ahead)
        self.ahead_ns = min(least, ahead), max(most, ahead)
        self.clock.add(message.log_time_ns, ahead)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        return {
            "topic": self.topic,
            "type": self.type,
            "encoding": self.encoding,
            "count": self.count,
            "first_ns": self.first_ns,
            "last_ns": self.last_ns,
            "rate_hz": self.rate_hz,
            "stamp_rate_hz": self.stamp_rate_hz,
            "missing": self.numbers.missing,
            "gaps": [{"after": before, "next": after} for before, after in self.numbers.gaps],
            "restarts": self.numbers.restarts,
            "numbered": self.numbered,
            "dropped": self.dropped,
            "longest_gap_s": _seconds(self.longest_gap_ns),
            "longest_gap_after_ns": None if self.longest_gap_ns is None else self.log_times.longest_after_ns,
            "jitter_s": _seconds(self.log_times.jitter_ns),
            "log_time_falls": self.log_times.falls,
            "stamp_ahead_s": None if self.ahead_ns is None else [_seconds(each) for each in self.ahead_ns],
        }


def _seconds(time_ns: int | None) -> float | None:
    return None if time_ns is None else time_ns / 10**9
