"""Messages in order of arrival become ticks: how many are taken in at a time changes none of them, nor their cuts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alignment.blocks import Block, BlockReader, Dropped, Kind, Times
from pipeline.alignment.clock import Place, StampOrder
from pipeline.alignment.config import AlignmentConfig, Transform
from pipeline.alignment.frames import StaticFrames, mounted, placed
from pipeline.alignment.track import NEVER, WAIT_NS, Span, Track
from pipeline.arrays import Floats
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE, TF_STATIC

_END_NS = 2**31 * 10**9  # no message has a stamp from here on
_MARKERS = frozenset((TF_STATIC, SESSION_PHASE))  # what comes after them is not as what came before
MOST_PHASES = 2**17
"""Phase markers that are remembered: more than any session has."""

_MAX_FRAMES = 100  # that are remembered of a topic
_PAUSE_NS = 10**9
_PAUSES = 10  # tolerances: ticks of a topic that are farther apart follow upon a pause


@dataclass(frozen=True)
class Source:
    """A topic that is aligned.

    Parameters
    ----------
    topic : str
        Its name in the log.
    ours : str
        Our name for it.
    kind : Kind
        What its messages are.
    """

    topic: str
    ours: str
    kind: Kind

    @property
    def turns(self) -> bool:
        """Whether it is of poses."""
        return self.kind.message is PoseStamped


class Ticks(NamedTuple):
    """Some ticks.

    Attributes
    ----------
    stamps_ns : ndarray, shape (n,)
        Their times [ns].
    values : tuple of ndarray, shape (n, d) each
        The values of each source.
    cuts : ndarray, shape (n,)
        Which of them do not follow upon the one before.
    """

    stamps_ns: Times
    values: tuple[Floats, ...]
    cuts: NDArray[np.bool_]


@dataclass
class SourceCounts:
    """What became of the messages of a topic: how many were used or not, and the times of those that were [ns]."""

    used: int = 0
    dropped: Counter[Dropped] = field(default_factory=Counter)
    first_ns: int | None = None
    last_ns: int | None = None
    frames: dict[str, None] = field(default_factory=dict)
    first_error: str = ""


class _Read(NamedTuple):
    """Messages of a source as they were read: arrivals and stamps [ns], both of shape (m,), and what they hold."""

    arrivals: NDArray[np.intp]
    stamps_ns: Times
    block: Block


_REASONS = np.zeros(len(Place), np.int8)
_REASONS[[Place.LATE, Place.AHEAD]] = Dropped.LATE, Dropped.AHEAD

_SEEN = (Dropped.NOT, Dropped.AHEAD)  # the first that is so begins a topic


class Aligner:
    """Makes ticks of messages.

    A tick is made where each topic has a message within the tolerance before it, and one within the tolerance after
    it; nothing is extrapolated. It is complete at the first message of every topic that is no earlier than the tick. A
    message that is no later by stamp than one of its topic before it is dropped, and a tick for which a topic is
    `WAIT_NS` behind another is given up: both in order of arrival, so that a log gives what its robot gave live. Stamps
    far ahead are dropped until their topic goes on there; once all topics go on far behind, a cycle begins.

    Parameters
    ----------
    sources : sequence of Source
        The topics; of joints and hands, in the order of the ticks' values.
    config : AlignmentConfig
        Tolerance, latencies, clock, frames and offsets.
    period_ns : int, optional
        Ticks at multiples of this [ns].
    pivot : int
        Place of the source whose stamps are the ticks, without a period.
    frames : StaticFrames
        Frames that are known.

    Attributes
    ----------
    counts : list of SourceCounts
        What became of the messages of each source.
    made, missed : int
        Ticks so far, and those between the first and the last of them that could not be made.
    restarts : int
        How many times the clock of the stamps began anew.
    phases : list of (int, RecordedMessage)
        Phase markers, each with the number of ticks that were made before it; `MOST_PHASES` of them at most.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        config: AlignmentConfig,
        *,
        period_ns: int | None,
        pivot: int,
        frames: StaticFrames,
    ) -> None:
        self.sources, self._config = tuple(sources), config
        self._period_ns, self._pivot, self._frames = period_ns, pivot, frames
        self._readers = [BlockReader(source.kind) for source in sources]
        self._ranks = {source.topic: rank for rank, source in enumerate(sources)}
        self._latencies = [config.latencies_ns.get(source.topic, 0) for source in sources]
        self._fixed: Mapping[int, Transform] = {
            rank: config.frames[source.topic] for rank, source in enumerate(sources) if source.topic in config.frames
        }
        self._order = StampOrder(len(sources))
        self.counts = [SourceCounts() for _ in sources]
        self.phases: list[tuple[int, RecordedMessage]] = []
        self.made = self.missed = self.restarts = 0
        self.begin()

    @property
    def topics(self) -> frozenset[str]:
        """Topics whose messages are wanted."""
        return frozenset((*self._ranks, TF_STATIC, SESSION_PHASE))

    def begin(self) -> None:
        """Begin a cycle: stamps start anew, and what waits is forgotten."""
        self._tracks = [Track(source.kind.size, turns=source.turns) for source in self.sources]
        self._ahead_ns = self._done_ns = self._made_ns = NEVER
        self._order.begin()
        self._since = 0  # candidates since the latest tick, none of which could be made

    @property
    def next_ns(self) -> int | None:
        """When the next tick may be, as far as is known [ns]; None if nothing is."""
        if self._period_ns is not None:
            if self._done_ns == NEVER:
                return None
            return (self._done_ns // self._period_ns + 1) * self._period_ns
        stamps = self._tracks[self._pivot].stamps_ns
        later = stamps[stamps > self._done_ns]
        return int(later[0]) if len(later) else None

    def feed(self, records: Sequence[RecordedMessage]) -> list[Ticks]:
        """Take in messages, in order of arrival, and return the ticks that they complete; others are passed over.

        A phase marker begins a cycle.
        """
        found, start, topics = list[Ticks](), 0, [record.topic for record in records]
        if not _MARKERS.isdisjoint(topics):
            for place, topic in enumerate(topics):
                if topic in _MARKERS:
                    found += self._feed(records[start:place], topics[start:place])
                    start = place + 1
                    if topic == SESSION_PHASE:
                        if len(self.phases) < MOST_PHASES:
                            self.phases.append((self.made, records[place]))
                        self.begin()
                    else:  # from here on it is known
                        self._frames.learn(records[place])
        return found + self._feed(records[start:], topics[start:])

    def _feed(self, records: Sequence[RecordedMessage], topics: Sequence[str]) -> list[Ticks]:
        found = list[Ticks]()
        ticks, restart = self._try(records, topics)
        while restart is not None:
            found += self._try(records[:restart], topics[:restart])[0]
            self.begin()
            self.restarts += 1
            records, topics = records[restart:], topics[restart:]
            ticks, restart = self._try(records, topics)
        return found + ticks

    def _try(self, records: Sequence[RecordedMessage], topics: Sequence[str]) -> tuple[list[Ticks], int | None]:
        """Take in messages and return the ticks that they complete; if the clock begins anew at one, which it is."""
        arrivals: list[list[int]] = [[] for _ in self.sources]
        ranks = self._ranks
        for place, topic in enumerate(topics):
            if topic in ranks:
                arrivals[ranks[topic]].append(place)
        read = [self._read(rank, records, places) for rank, places in enumerate(arrivals)]
        if (restart := self._check_order(read, len(records))) is not None:
            return [], restart
        return self._take(read, len(records)), None

    def _read(self, rank: int, records: Sequence[RecordedMessage], arrivals: list[int]) -> _Read:
        """Return messages of a source: arrivals, stamps [ns], and what they hold, in the robot's world."""
        block = self._readers[rank].read([records[place].data for place in arrivals])
        stamps, nothing = block.stamps_ns, Dropped.NO_STAMP
        if self._config.by_log_time:
            nothing = Dropped.NO_LOG_TIME
            stamps = np.array([min(records[place].log_time_ns, -NEVER) for place in arrivals], np.int64)
        block.dropped[(block.dropped == Dropped.NOT) & (stamps <= 0)] = nothing
        stamps = stamps - self._latencies[rank]
        block.dropped[(block.dropped == Dropped.NOT) & ((stamps < 0) | (stamps >= _END_NS))] = Dropped.OUT_OF_RANGE
        self._place(rank, block)
        return _Read(np.array(arrivals, np.intp), stamps, block)

    def _check_order(self, read: Sequence[_Read], count: int) -> int | None:
        """Drop messages out of order, or return the arrival at which the clock began anew."""
        ranks, stamps = np.full(count, -1, np.intp), np.zeros(count, np.int64)
        for rank, (arrivals, times, block) in enumerate(read):
            fine = block.dropped == Dropped.NOT
            ranks[arrivals[fine]], stamps[arrivals[fine]] = rank, times[fine]
        samples = np.flatnonzero(ranks >= 0)
        found, restart = self._order.check(ranks[samples], stamps[samples])
        if restart is not None:
            return int(samples[restart])
        reasons = np.zeros(count, np.int8)
        reasons[samples] = _REASONS[found]
        for arrivals, _, block in read:
            block.dropped[:] = np.where(block.dropped == Dropped.NOT, reasons[arrivals], block.dropped)
        return None

    def _take(self, read: Sequence[_Read], count: int) -> list[Ticks]:
        """Take in the samples among messages, and return the ticks that they complete."""
        latest = np.full(count + 1, NEVER, np.int64)
        latest[0] = self._ahead_ns
        fine = [block.dropped == Dropped.NOT for _, _, block in read]
        for (arrivals, stamps, _), used in zip(read, fine, strict=True):
            latest[arrivals[used] + 1] = stamps[used]
        np.maximum.accumulate(latest, out=latest)
        for rank, ((arrivals, stamps, block), used) in enumerate(zip(read, fine, strict=True)):
            self._count(rank, block, stamps)
            self._tracks[rank].add(stamps[used], block.values[used], latest[arrivals[used]])
            if self._period_ns is None and rank == self._pivot:  # candidates that came when they were given up already
                self._since += int((stamps[used] <= self._done_ns).sum())
        self._ahead_ns = int(latest[-1])
        return self._close()

    def _place(self, rank: int, block: Block) -> None:
        """Turn poses of what is tracked into those of the hand in the robot's world."""
        counts, source = self.counts[rank], self.sources[rank]
        if source.turns and source.topic in self._config.offsets:
            fine = block.dropped == Dropped.NOT
            block.values[fine] = mounted(block.values[fine], self._config.offsets[source.topic])
        for frame_id, indices in block.frames.items():
            if frame_id not in counts.frames and len(counts.frames) < _MAX_FRAMES:
                counts.frames[frame_id] = None
            if not source.turns:
                continue
            transform = self._fixed.get(rank) or self._frames.find(frame_id)
            known = indices[block.dropped[indices] == Dropped.NOT]
            if transform is None:
                block.dropped[known] = Dropped.UNKNOWN_FRAME
            else:
                block.values[known] = placed(transform, block.values[known])

    def _count(self, rank: int, block: Block, stamps: Times) -> None:
        counts = self.counts[rank]
        reasons, found = np.unique(block.dropped, return_counts=True)
        for reason, count in zip(reasons.tolist(), found.tolist(), strict=True):
            if reason == Dropped.NOT:
                counts.used += count
            else:
                counts.dropped[Dropped(reason)] += count
        counts.first_error = self._readers[rank].first_error
        if counts.first_ns is None and len(seen := stamps[np.isin(block.dropped, _SEEN)]):
            counts.first_ns = int(seen[0])
        if len(used := stamps[block.dropped == Dropped.NOT]):
            counts.last_ns = int(used[-1])

    def _close(self) -> list[Ticks]:
        """Return the ticks that are complete now."""
        limit = max(min(track.last_ns for track in self._tracks), self._ahead_ns - WAIT_NS - 1)
        if limit <= self._done_ns:
            return []
        ticks = self._due(limit)
        spans = [track.span(ticks, self._config.nearness_ns) for track in self._tracks]
        near = np.logical_and.reduce([span.near for span in spans])
        made = self._ticks_near(ticks, near, spans) if near.any() else None
        if self._period_ns is None:
            self._since = self._since + len(ticks) if made is None else len(ticks) - 1 - int(np.flatnonzero(near)[-1])
        self._done_ns = limit
        for track in self._tracks:
            track.forget_before(limit)
        return [] if made is None else [made]

    def _ticks_near(self, ticks: Times, near: NDArray[np.bool_], spans: Sequence[Span]) -> Ticks:
        """Return the ticks that can be made, and whether each follows upon the one before."""
        stamps = ticks[near]
        apart = np.diff(stamps, prepend=self._made_ns)
        if self._period_ns is not None:
            skipped = apart // self._period_ns - 1
            cuts = skipped > 0
        else:
            skipped = np.diff(np.flatnonzero(near), prepend=-1 - self._since) - 1
            cuts = (skipped > 0) | (apart > max(_PAUSES * self._config.nearness_ns, _PAUSE_NS))
        if self._made_ns == NEVER:
            cuts[0] = self.made > 0  # in a cycle before
            skipped[0] = 0
        values = tuple(
            track.between(stamps, Span(span.before[near], span.after[near], span.near[near]))
            for track, span in zip(self._tracks, spans, strict=True)
        )
        self.made += len(stamps)
        self.missed += int(skipped.sum())
        self._made_ns = int(stamps[-1])
        return Ticks(stamps, values, cuts)

    def _due(self, limit_ns: int) -> Times:
        """Return the times at which there may be a tick, up to a limit [ns], that were not looked at yet."""
        stamps = self._tracks[self._pivot].stamps_ns
        if self._period_ns is not None:
            stamps = _multiples(stamps, self._period_ns, self._config.nearness_ns, self._done_ns, limit_ns)
        return stamps[(stamps > self._done_ns) & (stamps <= limit_ns)]


def _multiples(stamps: Times, period_ns: int, tolerance_ns: int, after_ns: int, limit_ns: int) -> Times:
    """Return the multiples of a period that lie between samples near enough to each other, or at one [ns]."""
    if not len(stamps):
        return stamps
    start, end = np.concatenate((stamps[:1] - 1, stamps[:-1])), stamps
    first, last = start // period_ns + 1, end // period_ns
    wide = end - start > 2 * tolerance_ns
    first = np.where(wide, np.where(end % period_ns == 0, last, last + 1), first)
    first, last = np.maximum(first, after_ns // period_ns + 1), np.minimum(last, limit_ns // period_ns)
    counts = np.maximum(last - first + 1, 0)
    before = np.cumsum(counts) - counts
    return (np.repeat(first - before, counts) + np.arange(int(counts.sum()))) * period_ns
