"""Ticks of what anyone publishes: one bad message is refused, one incomplete tick given up, and the rest goes on."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from recorders.cdr.codec import stamp_ns
from recorders.errors import JointError, MessageError, OutOfRange
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, is_measured
from recorders.ticks.joiner import NO_POSES, Check, PoseReader, TickInput, joints_rank, pass_all
from recorders.ticks.stamp_joiner import OpenTick, RejectionError, StampJoiner, name_of

MAX_PENDING = 64
"""Ticks that may wait for more of their messages: how far one publisher may run ahead of another."""

WAIT_TICKS = 16
"""Ticks of joints alone after which hands are taken not to be measured, if no tick with hands was complete by then."""

MAX_MESSAGE = 64 << 10
"""Larger messages are refused undecoded [bytes]: a pose takes some 100, the joints of a large robot a few thousand."""


RESTARTED_AFTER = 10
"""Messages in a row of every topic, each later than the one before, that lie far behind: the clock began anew."""

FAR_BEHIND_NS = 10 * 10**9
"""Messages farther behind the last tick than this [ns] are no latecomers."""


class LiveTick(NamedTuple):
    """A complete tick: its messages in canonical order, and whether one before it, of the same cycle, is missing."""

    stamp_ns: int
    records: tuple[RecordedMessage, ...]
    after_gap: bool


class _Behind:
    """The messages far behind the last tick, by topic: how many came in a row, and the stamp of the latest."""

    def __init__(self, topics: int) -> None:
        self._counts, self._stamps = [0] * topics, [-1] * topics

    def note(self, rank: int, stamp: int) -> bool:
        """Note one; returns whether every topic now goes on there."""
        self._counts[rank] = self._counts[rank] + 1 if stamp > self._stamps[rank] else 1
        self._stamps[rank] = stamp
        return min(self._counts) >= RESTARTED_AFTER


_APART = 4  # two counters that one tick raises by less than this in all are not one counter over both topics


class _Numbers:
    """The producers' numbers of the latest tick, by which whole ticks that never came are seen.

    Numbers count the messages of one topic, or those of several: then they jump between any two ticks, and mean nothing
    of what is missing. Two topics share a counter if their numbers lie side by side, tick after tick, and never were
    too near for that, or the same.
    """

    def __init__(self) -> None:
        self._latest: Sequence[int | None] = ()
        self._apart: set[tuple[int, int]] = set()  # pairs of topics, by rank, that do not share a counter

    def begin(self) -> None:
        """Begin a new cycle, whose numbers follow upon nothing."""
        self._latest = ()

    @property
    def known(self) -> bool:
        """Whether there is a tick before the next."""
        return bool(self._latest)

    def jump(self, numbers: Sequence[int | None]) -> bool:
        """Take the numbers of the next tick; returns whether a tick between it and the one before never came."""
        before, self._latest = self._latest or numbers, tuple(numbers)
        steps = zip(before, numbers, strict=True)
        found = [(old, new) for old, new in steps if old is not None and new is not None and new > old]
        if len(found) < len(numbers):
            return False
        pairs = list(combinations(range(len(found)), 2))
        self._apart |= {pair for pair in pairs if _too_near(*(found[rank] for rank in pair))}
        shared = any(_side_by_side(*(found[rank] for rank in pair)) for pair in pairs if pair not in self._apart)
        return not shared and all(new > old + 1 for old, new in found)


def _too_near(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether the numbers of two topics in two ticks, each old and new, cannot come from one counter."""
    raised = sum(new - old for old, new in (one, other))
    return raised < _APART or bool(set(one) & set(other))


def _side_by_side(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether the numbers of two topics go on as those of one counter do: both of a tick before both of the next."""
    return max(one[0], other[0]) < min(one[1], other[1])


class LiveTicks:
    """Joins messages of any publishers to ticks, exactly on the stamp.

    Unlike `TickJoiner` it expects nothing of them. A refused message changes nothing. Time is that of the last complete
    tick, so that no single message can move it; once all topics go on far behind it, as when a simulator is reset, it
    starts anew there, as it does for an alignment. A tick that waits is given up when a later one is complete, as on
    each topic messages come in order, or when too many wait. Whole ticks that never came are seen by the numbers of
    their producers, where they give any. Joints may come more often than targets, and hands as measured more often than
    joints: alone they are no tick.

    Parameters
    ----------
    check : callable
        What else is asked of a position or of joints.
    topics : sequence of str
        The topics that a tick has a message of each: hands in the order wanted, and the joints.
    poses : mapping of str to callable
        Readers of the topics of hands whose pose is controlled.

    Attributes
    ----------
    dropped : int
        Stamps given up so far, as messages of theirs never came.
    restarts : int
        How many times the clock of the stamps began anew without a phase marker.
    """

    def __init__(
        self,
        check: Check = pass_all,
        topics: Sequence[str] = COMMANDED_TICK,
        poses: Mapping[str, PoseReader] = NO_POSES,
    ) -> None:
        self._check = check
        self._inputs = {topic: (rank, TickInput(topic, poses.get(topic))) for rank, topic in enumerate(topics)}
        measured = {rank for rank, topic in enumerate(topics) if is_measured(topic)}
        self._surplus = measured or {joints_rank(topics)}  # ranks of what may come more often
        self._measured = measured
        self._ticks: StampJoiner[int | None] = StampJoiner(topics, limit=MAX_PENDING, give_up=self._give_up)
        self._refused_at: dict[int, None] = {}  # stamps of targets that were refused, in order of arrival
        self._numbers, self._behind = _Numbers(), _Behind(len(topics))
        self.dropped = self.restarts = 0
        self.begin()

    def begin(self) -> None:
        """Begin a new cycle: ticks that wait are given up, and time starts anew."""
        self.dropped += sum(self._counts(tick) for _, tick in self._ticks.waiting())
        self._ticks.clear()
        self._refused_at.clear()
        self._numbers.begin()
        self._last_ns = -1
        self._anew = False  # whether the clock began anew since the last complete tick
        self._lost = False  # whether a tick was given up since the last complete one

    def feed(self, record: RecordedMessage, *, numbered: bool) -> LiveTick | None:
        """Take in a message on one of the tick's topics, and return the tick that it completes.

        Parameters
        ----------
        record : RecordedMessage
            The message.
        numbered : bool
            Whether its sequence is its producer's.

        Raises
        ------
        RejectionError
            If the message is of no use.
        """
        rank, tick_input = self._inputs[record.topic]
        try:
            stamp = self._read(record, tick_input)
        except RejectionError:
            self._note_refused(record, rank)
            raise
        if stamp <= self._last_ns:
            line = f"{name_of(record)}: stamp {stamp} ns is not after the tick at {self._last_ns} ns"
            self._note_behind(rank, stamp)
            raise RejectionError("not after the last tick", line)
        parts = self._ticks.add(stamp, rank, record, record.sequence if numbered else None)
        return None if parts is None else self._complete(stamp, parts)

    def _note_behind(self, rank: int, stamp: int) -> None:
        """Note a stamp before the last tick; once every topic goes on far behind, a cycle begins."""
        if stamp < self._last_ns - FAR_BEHIND_NS and self._behind.note(rank, stamp):
            self.begin()
            self.restarts += 1
            self._anew = True

    def _read(self, record: RecordedMessage, tick_input: TickInput) -> int:
        if len(record.data) > MAX_MESSAGE:
            line = f"{name_of(record)}: {len(record.data)} bytes, expected at most {MAX_MESSAGE}"
            raise RejectionError("too large", line)
        try:
            stamp, value = tick_input.read(record)
        except MessageError as error:
            kind = "implausible" if isinstance(error, OutOfRange) else "unreadable"
            raise RejectionError(kind, str(error)) from None
        try:
            self._check(value)
        except (JointError, MessageError) as error:
            kind = "wrong joints" if isinstance(error, JointError) else "implausible"
            raise RejectionError(kind, f"{name_of(record)}: {error}") from None
        return stamp

    def _note_refused(self, record: RecordedMessage, rank: int) -> None:
        """Note where there was what makes a tick, if of no use: the rest alone at that stamp is a lost tick."""
        try:
            stamp = stamp_ns(record.type, record.data)
        except MessageError:
            return
        if rank in self._surplus or stamp is None or stamp <= self._last_ns:
            return
        self._refused_at[stamp] = None
        if len(self._refused_at) > MAX_PENDING:
            del self._refused_at[next(iter(self._refused_at))]

    def _complete(self, stamp: int, parts: list[tuple[RecordedMessage, int | None]]) -> LiveTick:
        for earlier in [other for other in self._refused_at if other <= stamp]:
            del self._refused_at[earlier]
        known, jumped = self._numbers.known, self._numbers.jump([number for _, number in parts])
        gap = self._anew or (known and (self._lost or jumped))
        self._last_ns, self._lost, self._anew = stamp, False, False
        self._behind = _Behind(len(self._inputs))
        return LiveTick(stamp, tuple(record for record, _ in parts), gap)

    def _counts(self, tick: OpenTick) -> bool:
        """Whether there is more of a tick than hands as measured, which robots publish at a rate of their own."""
        return any(part is not None for rank, part in enumerate(tick) if rank not in self._measured)

    def _give_up(self, stamp: int, tick: OpenTick, _but: str) -> None:
        self.dropped += self._counts(tick)
        wanted = any(part is not None for rank, part in enumerate(tick) if rank not in self._surplus)
        self._lost |= wanted or stamp in self._refused_at
