"""Two logs side by side: the channels in which the order of messages counts, read in step and matched."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from recorders.cdr.codec import stamp_ns
from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE, canonical_place, is_of_tick
from replay.diff.rules import EXACT, Rules

LOOKAHEAD = 4096
"""Messages that are read of each log beyond the first that differ, to distinguish a dropped one from two swapped."""

MAX_SKEW = 65536
"""A message of a channel is missing if so many later ones have come from the other log: memory is bounded."""


@dataclass(slots=True, eq=False)
class Entry:
    """A message of one log, and where it stands in it.

    Attributes
    ----------
    record : RecordedMessage
        The message.
    tick_ns : int or None
        Stamp of the tick that it is part of [ns]; None for messages that stand alone.
    cycle, seen_ns, place : int
        Phase markers before it in the log, the last stamp of a tick up to it [ns], messages before it.
    rules : Rules
        What counts as the same.
    agreed : bool
        Whether the other log has the same message at its place.
    """

    record: RecordedMessage
    tick_ns: int | None
    cycle: int
    seen_ns: int
    place: int
    rules: Rules
    agreed: bool = False

    @property
    def is_marker(self) -> bool:
        """Whether the message is a phase marker."""
        return self.record.topic == SESSION_PHASE

    @property
    def rank(self) -> tuple[int, str]:
        """Place of the topic in the canonical order; foreign topics come last."""
        return canonical_place(self.record.topic)

    @property
    def stamp_ns(self) -> int | None:
        """The stamp of the header [ns], None if there is none that can be read."""
        try:
            return stamp_ns(self.record.type, self.record.data)
        except MessageError:
            return None

    @property
    def moment(self) -> tuple[int, int, tuple[int, str], int]:
        """Sorts the entries of a log: by cycle (cycles repeat stamps), stamp, rank, place."""
        own = self.stamp_ns
        return self.cycle, self.seen_ns if own is None else own, self.rank, self.place

    def same(self, other: "Entry") -> bool:
        """Whether two messages are the same by the rules; the time of recording does not enter."""
        return self.rules.same(self.record, other.record)

    def same_number(self, other: "Entry") -> bool:
        """Whether two messages have the same topic and sequence, if numbers count, whatever they hold."""
        a, b = self.record, other.record
        return self.rules.numbered and (a.topic, a.sequence) == (b.topic, b.sequence)


Queues: TypeAlias = tuple[deque[Entry], deque[Entry]]


class AlignedQueue:
    """Messages of both logs that have one order; those of one tick, in a row, are brought into that of their ranks.

    Attributes
    ----------
    queues : pair of deque
        What has come from either log and has not yet met its like, in canonical order.
    parted : bool
        Whether the two heads of the queues are different messages; nothing is matched beyond that.
    """

    def __init__(self) -> None:
        self.queues: Queues = (deque(), deque())
        self.parted = False
        self._ticks: tuple[list[Entry], list[Entry]] = ([], [])

    def push(self, side: int, entry: Entry) -> None:
        """Take in the next message of a log and match what can be matched."""
        tick = self._ticks[side]
        if tick and tick[-1].tick_ns != entry.tick_ns:
            self._end_tick(side)
        if entry.tick_ns is None:
            self.queues[side].append(entry)
        else:
            tick.append(entry)
        self._match()

    def close(self) -> None:
        """Both logs are over: what is left on one side alone parts them."""
        for side in (0, 1):
            self._end_tick(side)
        self._match()
        self.parted = any(self.queues)

    def _end_tick(self, side: int) -> None:
        tick = self._ticks[side]
        self.queues[side].extend(sorted(tick, key=lambda entry: entry.rank))
        tick.clear()

    def _match(self) -> None:
        a, b = self.queues
        while a and b and a[0].same(b[0]):
            a.popleft().agreed = b.popleft().agreed = True
        self.parted = bool(a and b) or max(len(a), len(b)) > MAX_SKEW


class LogAligner:
    """Reads two logs in step and sorts their messages to channels.

    The learner's topics and the phase markers are one channel; every other topic is one of its own, since two
    publishers interleave differently from run to run.

    Parameters
    ----------
    a, b : iterable of RecordedMessage
        The logs, in their own order.
    rules : Rules
        What counts as the same.
    """

    def __init__(self, a: Iterable[RecordedMessage], b: Iterable[RecordedMessage], rules: Rules = EXACT) -> None:
        self._channels: dict[str, AlignedQueue] = {}
        self._logs = (_entries(a, rules), _entries(b, rules))

    def read(self) -> Iterator[Entry]:
        """Read until the logs are over, or `LOOKAHEAD` beyond their parting; yield the entries of the second."""
        left = LOOKAHEAD
        while left > 0:
            a, b = (next(log, None) for log in self._logs)
            if a is None and b is None:
                self._close()
                return
            parted = [self._push(side, entry) for side, entry in enumerate((a, b)) if entry is not None]
            if any(parted) or left < LOOKAHEAD:
                left = left - 1 if self.parted() else LOOKAHEAD  # what seemed to be missing may still have come
            if b is not None:
                yield b

    def parted(self) -> list[Queues]:
        """Return what is left in the channels that have parted."""
        return [channel.queues for channel in self._channels.values() if channel.parted]

    def _close(self) -> None:
        for channel in self._channels.values():
            channel.close()

    def _push(self, side: int, entry: Entry) -> bool:
        topic = entry.record.topic
        name = SESSION_PHASE if is_of_tick(topic) else topic
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = AlignedQueue()
        channel.push(side, entry)
        return channel.parted


def _entries(records: Iterable[RecordedMessage], rules: Rules) -> Iterator[Entry]:
    cycle = seen = 0
    for place, record in enumerate(records):
        entry = Entry(record, None, cycle, seen, place, rules)
        if is_of_tick(record.topic):
            entry.tick_ns = entry.stamp_ns
            entry.seen_ns = seen = seen if entry.tick_ns is None else entry.tick_ns
        elif entry.is_marker:
            cycle, seen = cycle + 1, 0
        yield entry
