"""Summary of a log: topics with rates and gaps, times, manifest, attachments, sessions, and whether it is sound."""

import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from mcap.records import Statistics

from recorders.cdr.codec import decode_as
from recorders.errors import MessageError
from recorders.mcap_format.channels import ChannelRegistry
from recorders.mcap_format.manifest import ContentHash
from recorders.messages.message_types import String
from recorders.messages.phase import Phase
from recorders.messages.topics import SESSION_PHASE
from recorders.recovery.clocks import Disagreement, disagreements
from recorders.recovery.salvage import LogSurvey, Salvaged
from recorders.recovery.survey import CUT_OFF, survey
from recorders.recovery.topic_info import TopicSummary

_NS = 1e9
_FEWEST_SHARED = 3  # messages that show whose numbers they have
_CLOCKS_COMPARED = 100  # topics
_RUNS_NAMED = 20  # a log may come from anyone


@dataclass
class SessionSummary:
    """The phase markers of one run: the epochs, counted from 0, and the number of markers of each phase."""

    run: str
    first_epoch: int
    last_epoch: int
    cycles: Counter[str] = field(default_factory=Counter)

    def add(self, phase: Phase) -> None:
        """Take in a marker."""
        self.first_epoch = min(self.first_epoch, phase.epoch)
        self.last_epoch = max(self.last_epoch, phase.epoch)
        self.cycles[phase.phase] += 1

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        return {
            "run": self.run,
            "first_epoch": self.first_epoch,
            "last_epoch": self.last_epoch,
            "cycles": dict(self.cycles),
        }


@dataclass
class LogSummary:
    """The summary of a log.

    Attributes
    ----------
    survey : LogSurvey
        The file and what of it can be believed.
    topics : dict
        What is on each topic.
    sessions : dict
        The phase markers of each run; the first few runs.
    undeclared : int
        Messages on channels whose declaration is lost.
    unprotected : int
        Messages in no chunk with a CRC.
    content_holds : bool or None
        Whether the messages are those of which the manifest has the hash; None if it has none.
    wrong_totals : list of str
        What the log's summary counts otherwise than they were found, such as "12 messages, found 11".
    counts_hold : bool or None
        Whether everything is there as often as the log's summary states; None if it does not.
    """

    survey: LogSurvey
    topics: dict[str, TopicSummary] = field(default_factory=dict)
    sessions: dict[str, SessionSummary] = field(default_factory=dict)
    undeclared: int = 0
    unprotected: int = 0
    content_holds: bool | None = None
    wrong_totals: list[str] = field(default_factory=list)
    counts_hold: bool | None = None
    _content: ContentHash = field(default_factory=ContentHash)
    _last_number: int = -1
    _rising: bool = True

    @property
    def sound(self) -> bool:
        """Whether the log is whole and undamaged."""
        checks = (self.content_holds, self.counts_hold)
        return not (self.survey.damage or self.undeclared or False in checks)

    @property
    def protected(self) -> bool:
        """Whether CRCs protect every message."""
        return self.survey.data_crc or not self.unprotected

    @property
    def cut_off_at(self) -> int | None:
        """Offset at which the log is cut off [bytes], None if it is not."""
        return next((damage.offset for damage in self.survey.damage if damage.reason == CUT_OFF), None)

    @property
    def times_ns(self) -> tuple[int, int] | None:
        """Log time of the earliest and the latest message [ns]; None if there is no message."""
        if not self.topics:
            return None
        return min(each.first_ns for each in self.topics.values()), max(each.last_ns for each in self.topics.values())

    @property
    def clocks(self) -> list[Disagreement]:
        """Topics whose stamps are of another clock than those of most; a few, as a log may come from anyone."""
        return list(disagreements(islice(self.topics.values(), _CLOCKS_COMPARED)))

    def add(self, message: Salvaged) -> None:
        """Take in a message."""
        channel = message.channel
        if channel is None:
            self.undeclared += 1
            return
        topic = self.topics.get(channel.topic)
        if topic is None:
            topic = self.topics[channel.topic] = TopicSummary(channel.topic, channel.type, channel.encoding)
        topic.add(message)
        self._rising &= message.sequence > self._last_number
        self._last_number = message.sequence
        self.unprotected += not message.protected
        self._content.add(channel.topic, message.sequence, message.log_time_ns, message.data, message.rest)
        if channel.topic == SESSION_PHASE:
            self._add_phase(message.data)

    def judge_numbers(self) -> None:
        """See whether all topics share one row of numbers: what one of them lacks, another has then."""
        count = sum(topic.count for topic in self.topics.values())
        if self._rising and len(self.topics) > 1 and count >= _FEWEST_SHARED:
            for topic in self.topics.values():
                topic.take_no_numbers()

    def finish(self) -> None:
        """Compare the content with what manifest and summary state."""
        self.judge_numbers()
        expected = self.survey.manifest.get("content_sha256")
        self.content_holds = None if expected is None else expected == self._content.hexdigest()
        stated = self.survey.summary.statistics if self.survey.summary else None
        if stated is not None:
            self.wrong_totals = list(self._wrong_totals(stated))
            self.counts_hold = not self.wrong_totals

    def _wrong_totals(self, stated: Statistics) -> Iterator[str]:
        found = self.survey
        counts = Counter({topic.topic: topic.count for topic in self.topics.values()})
        totals = {
            "messages": (stated.message_count, counts.total() + self.undeclared),
            "chunks": (stated.chunk_count, found.chunks.total()),
            "attachments": (stated.attachment_count, len(found.attachments)),
            "metadata records": (stated.metadata_count, found.metadata_count),
        }
        totals |= self._declared_totals(stated) | self._time_totals(stated)
        by_topic = found.stated_counts or Counter()
        totals |= {f"messages on {topic}": (by_topic[topic], counts[topic]) for topic in by_topic}
        if by_topic:
            totals |= {f"messages on {topic}": (0, counts[topic]) for topic in counts if topic not in by_topic}
        return (f"{count} {what}, found {there}" for what, (count, there) in totals.items() if count != there)

    def _time_totals(self, stated: Statistics) -> dict[str, tuple[int, int]]:
        """Return stated and found times of the first and the last message; some writers state none, which is 0."""
        times = stated.message_start_time, stated.message_end_time
        if self.times_ns is None or self.undeclared or not any(times):
            return {}
        first, last = zip(times, self.times_ns, strict=True)
        return {"ns as the time of the first message": first, "ns as that of the last": last}

    def _declared_totals(self, stated: Statistics) -> dict[str, tuple[int, int]]:
        """Return stated and found numbers of channels and schemas; some writers count those that they left out."""
        repeated = self.survey.summary.declarations if self.survey.summary else ChannelRegistry()
        met, totals = self.survey.met, {}
        for what, count, ids, listed in (
            ("channels", stated.channel_count, met.channels, repeated.channels),
            ("schemas", stated.schema_count, met.schemas, repeated.schemas),
        ):
            there = len(ids.keys() | listed.keys())
            if count < there or listed:
                totals[what] = count, there
        return totals

    def _add_phase(self, data: bytes) -> None:
        try:
            phase = Phase.from_message(decode_as(String, data))
        except MessageError:
            return
        if phase.run in self.sessions or len(self.sessions) < _RUNS_NAMED:
            self.sessions.setdefault(phase.run, SessionSummary(phase.run, phase.epoch, phase.epoch)).add(phase)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        found, times = self.survey, self.times_ns
        return {
            "path": str(found.path),
            "size": found.size,
            "sound": self.sound,
            "finished": found.finished,
            "complete": found.manifest.get("complete"),
            "cut_off_at": self.cut_off_at,
            "protected": self.protected,
            "content_holds": self.content_holds,
            "counts_hold": self.counts_hold,
            "wrong_totals": self.wrong_totals,
            "profile": found.profile,
            "library": found.library,
            "messages": sum(topic.count for topic in self.topics.values()),
            "undeclared": self.undeclared,
            "first_ns": times and times[0],
            "last_ns": times and times[1],
            "duration_s": times and (times[1] - times[0]) / _NS,
            "chunks": found.chunks.total(),
            "compression": {name or "none": count for name, count in found.chunks.items()},
            "topics": [topic.to_dict() for topic in self.topics.values()],
            "clocks": [each.to_dict() for each in self.clocks],
            "sessions": [session.to_dict() for session in self.sessions.values()],
            "attachments": [{"name": each.name, "size": each.size} for each in found.attachments],
            "manifest": found.manifest,
            "damage": [damage._asdict() for damage in found.damage],
        }


def summarise(
    path: str | os.PathLike[str], *, on_progress: Callable[[float], None] = lambda fraction: None
) -> LogSummary:
    """Read a log from end to end and return what is in it, behind damage too.

    Parameters
    ----------
    path : path
        An MCAP file of any writer.
    on_progress : callable
        Called with the fraction done.

    Raises
    ------
    LogError
        If there is no such file, it cannot be read, or it is not MCAP at all.
    """
    found = survey(Path(path), on_progress=lambda fraction: on_progress(fraction / 2))
    summary = LogSummary(found)
    for message in found.messages(on_progress=lambda fraction: on_progress((1 + fraction) / 2)):
        summary.add(message)
        del message  # a large one would take memory beside the next
    summary.finish()
    return summary
