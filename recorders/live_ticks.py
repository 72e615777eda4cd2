"""Ticks of what anyone publishes: one bad message is refused, one incomplete tick given up, and the rest goes on."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from recorders.errors import JointError, MessageError
from recorders.fields import FloatArray
from recorders.messages import JointState
from recorders.records import Stamped
from recorders.ticks import RANKS, read_input
from recorders.topics import LEARNER_TOPICS

MAX_PENDING = 64
"""Ticks that may wait for more of their messages: how far one publisher may run ahead of another."""

MAX_MESSAGE = 64 << 10
"""Larger messages are refused undecoded [bytes]: a pose takes some 100, the joints of a large robot a few thousand."""

Check: TypeAlias = Callable[[FloatArray | JointState], None]
"""Raises JointError or MessageError for a target [m] (3,) or joints that cannot be the robot's."""


class Refused(MessageError):
    """A message is of no use; `kind` says why in a word or two."""

    def __init__(self, kind: str, line: str) -> None:
        super().__init__(line)
        self.kind = kind


class _Part(NamedTuple):
    """A message of a tick that waits, and its producer's number, if it has one."""

    record: Stamped
    number: int | None


class LiveTick(NamedTuple):
    """A complete tick: its messages in canonical order, and whether one before it, of the same cycle, is missing."""

    stamp_ns: int
    records: tuple[Stamped, ...]
    after_gap: bool


class LiveTicks:
    """Joins messages of any publishers to ticks, exactly on the stamp.

    Unlike `TickJoiner` it expects nothing of them. A refused message changes nothing. Time is that of the last complete
    tick, so that no single message can move it. A tick that waits is given up when a later one is complete, as on each
    topic messages come in order, or when too many wait. Whole ticks that never came are seen by the numbers of their
    producers, where they give any.

    Parameters
    ----------
    check : callable
        What else is asked of a target or of joints.

    Attributes
    ----------
    dropped : int
        Ticks given up so far.
    """

    def __init__(self, check: Check = lambda value: None) -> None:
        self._check = check
        self._pending: dict[int, list[_Part | None]] = {}  # by stamp, in order of arrival
        self.dropped = 0
        self.begin()

    def begin(self) -> None:
        """Begin a new cycle: ticks that wait are given up, and time starts anew."""
        self.dropped += len(self._pending)
        self._pending.clear()
        self._last_ns = -1
        self._numbers: list[int | None] = []  # of the last complete tick
        self._lost = False  # whether a tick was given up since then

    def feed(self, record: Stamped, *, numbered: bool) -> LiveTick | None:
        """Take in a message on one of the learner's topics, and return the tick that it completes.

        Parameters
        ----------
        record : Stamped
            The message.
        numbered : bool
            Whether its sequence is its producer's.

        Raises
        ------
        Refused
            If the message is of no use.
        """
        rank = RANKS[record.topic]
        stamp = self._read(record, rank)
        tick = self._find(record, rank, stamp)
        tick[rank] = _Part(record, record.sequence if numbered else None)
        present = [part for part in tick if part is not None]
        return self._complete(stamp, present) if len(present) == len(tick) else None

    def _read(self, record: Stamped, rank: int) -> int:
        if len(record.data) > MAX_MESSAGE:
            line = f"{record.topic} #{record.sequence}: {len(record.data)} bytes, expected at most {MAX_MESSAGE}"
            raise Refused("too large", line)
        try:
            stamp, value = read_input(record, rank)
        except MessageError as error:
            raise Refused("unreadable", str(error)) from None
        try:
            self._check(value)
        except (JointError, MessageError) as error:
            kind = "wrong joints" if isinstance(error, JointError) else "implausible"
            raise Refused(kind, f"{record.topic} #{record.sequence}: {error}") from None
        return stamp

    def _find(self, record: Stamped, rank: int, stamp: int) -> list[_Part | None]:
        if stamp <= self._last_ns:
            raise Refused(
                "not after the last tick",
                f"{record.topic} #{record.sequence}: stamp {stamp} ns is not after the tick at {self._last_ns} ns; "
                "time starts anew with a phase marker only",
            )
        tick = self._pending.get(stamp)
        if tick is None:
            if len(self._pending) >= MAX_PENDING:
                self._give_up(next(iter(self._pending)))
            tick = self._pending[stamp] = [None] * len(LEARNER_TOPICS)
        elif tick[rank] is not None:
            line = f"{record.topic} #{record.sequence}: a second message at {stamp} ns, expected one per tick"
            raise Refused("repeated", line)
        return tick

    def _complete(self, stamp: int, parts: list[_Part]) -> LiveTick:
        del self._pending[stamp]
        for earlier in [other for other in self._pending if other < stamp]:
            self._give_up(earlier)
        numbers = [part.number for part in parts]
        gap = bool(self._numbers) and (self._lost or self._jumped(numbers))
        self._last_ns, self._numbers, self._lost = stamp, numbers, False
        return LiveTick(stamp, tuple(part.record for part in parts), gap)

    def _give_up(self, stamp: int) -> None:
        del self._pending[stamp]
        self.dropped += 1
        self._lost = True

    def _jumped(self, numbers: list[int | None]) -> bool:
        """Whether messages between the last tick and this one never came: on every topic, or one would be waiting."""
        pairs = zip(self._numbers, numbers, strict=True)
        return all(old is not None and new is not None and new > old + 1 for old, new in pairs)
