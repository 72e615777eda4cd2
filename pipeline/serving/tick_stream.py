"""Messages of a served controller's topics, joined to ticks: checked one by one, in the order of their stamps."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

from pipeline.robot.config import RobotConfig
from pipeline.robot.range_check import range_check
from pipeline.samples.pairing import PairingRule, find_pairing
from pipeline.serving.clock_reset import StampOrder
from pipeline.serving.inputs import JointsReader, TargetReader, reader_of
from pipeline.serving.rejections import Rejection
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import is_measured
from recorders.ticks.live import WAIT_TICKS
from recorders.ticks.stamp_joiner import OpenTick, RejectionError, StampJoiner

MAX_OPEN = 64
"""Ticks that wait for a partner; whoever sends halves alone must not fill the memory."""

Parts: TypeAlias = list[tuple[RecordedMessage, Any]]
"""Messages of a tick and their values, in the order of the topics."""


class TickStream:
    """Joins messages to ticks; whoever takes one sets `order.last_ns` to its stamp.

    Hands as measured may come more often than joints do: those without joints are passed over.

    Parameters
    ----------
    topics : sequence of str
        The topics of a tick.
    readers : sequence of TargetReader or JointsReader
        Readers of these topics.
    reject : callable
        Takes reason and line of each message that never finds its partners.
    restart : callable
        Takes stamp [ns] and reason once enough ticks in a row go on where another clock is.

    Attributes
    ----------
    order : StampOrder
        The stamp of the last tick, and which can follow it.
    """

    def __init__(
        self,
        topics: Sequence[str],
        readers: Sequence[TargetReader | JointsReader],
        *,
        reject: Callable[[str, str], None],
        restart: Callable[[int, Rejection], None],
    ) -> None:
        self._readers, self._reject, self._restart = tuple(readers), reject, restart
        self._ranks = {topic: rank for rank, topic in enumerate(topics)}
        self._surplus = [is_measured(topic) for topic in topics]
        self._ticks: StampJoiner[Any] = StampJoiner(topics, limit=MAX_OPEN, give_up=self._give_up)
        self.order = StampOrder(len(self._readers))

    def __contains__(self, topic: str) -> bool:
        """Whether messages of a topic are parts of a tick."""
        return topic in self._ranks

    @property
    def open(self) -> bool:
        """Whether a message waits for others of its tick."""
        return bool(self._ticks.open)

    def begin(self, last_ns: int = -1) -> None:
        """Begin a cycle: with any stamp, or after one of the clock that is followed from now on."""
        self._ticks.clear()
        self.order.begin(last_ns)

    def take(self, record: RecordedMessage) -> tuple[int, Parts] | None:
        """Take in a message of one of the topics; return stamp [ns] and parts of the tick that it completes, if any.

        Raises
        ------
        RejectionError
            If the message cannot be used.
        """
        rank = self._ranks[record.topic]
        stamp, value = self._readers[rank].read(record)
        self._check_stamp(record, rank, stamp)
        parts = self._ticks.add(stamp, rank, record, value)
        return None if parts is None else (stamp, parts)

    def _check_stamp(self, record: RecordedMessage, rank: int, stamp: int) -> None:
        """Reject a stamp that cannot follow the last; after enough of them a clock has begun anew."""
        reason = self.order.rejection(stamp)
        if reason is None:
            return
        soon = "soon " if reason is Rejection.AHEAD else ""
        line = f"{record.topic}: expected a stamp {soon}after {self.order.last_ns} ns, found {stamp} ns"
        if self.order.goes_on(reason, rank, stamp):
            self._restart(stamp, reason)
        raise RejectionError(reason, line)

    def _give_up(self, stamp: int, tick: OpenTick, _but: str) -> None:
        if all(part is None or surplus for part, surplus in zip(tick, self._surplus, strict=True)):
            return
        absent = ", ".join(self._ticks.absent(tick))
        for record, _ in filter(None, tick):
            self._reject(Rejection.NO_PARTNER, f"{record.topic}: {absent} at {stamp} ns never came")


class MeasuredTicks:
    """Ticks that a served controller learns from apart from the targets: of its pairs, or of those in their place.

    Until one of the former is complete, or `WAIT_TICKS` of the latter are, ticks are held back; then all are given of
    those that are chosen.

    Parameters
    ----------
    pairing : PairingRule
        The rule of the controller.
    robot : RobotConfig
        Whose joints and hands they are.
    reject : callable
        Takes reason and line of each message that never finds its partners.
    on_choice : callable
        Takes the rule in place of the controller's, before its first tick is given, if that is chosen.
    """

    def __init__(
        self,
        pairing: PairingRule,
        robot: RobotConfig,
        *,
        reject: Callable[[str, str], None],
        on_choice: Callable[[PairingRule], None],
    ) -> None:
        self._robot, self._on_choice = robot, on_choice
        self.topics = pairing.topics(robot.hand_names)
        self._stream = self._make(pairing, reject)
        self._otherwise = find_pairing(pairing.otherwise) if pairing.otherwise else None
        self._other = None if self._otherwise is None else self._make(self._otherwise, lambda reason, line: None)
        self._held: list[tuple[int, Parts]] = []
        self._seen = 0

    def begin(self) -> None:
        """Begin a cycle: with any stamp, and nothing held back."""
        self._stream.begin()
        if self._other is not None:
            self._other.begin()
        self._held = []

    def take(self, record: RecordedMessage) -> list[tuple[int, Parts]]:
        """Take in a message; return stamp [ns] and parts of each tick that can be learned now.

        Raises
        ------
        RejectionError
            If the message cannot be used.
        """
        if self._other is None or self._otherwise is None:
            return _completed(self._stream, record)
        with suppress(RejectionError):  # which the other stream has a word for
            found = _completed(self._other, record)
            self._held += found
            self._seen += len(found)
        found = _completed(self._stream, record)
        if not found and self._seen < WAIT_TICKS:
            return []
        if not found:
            self._stream, found = self._other, self._held
            self._on_choice(self._otherwise)
        self._other, self._held = None, []
        return found

    def _make(self, pairing: PairingRule, reject: Callable[[str, str], None]) -> TickStream:
        """Return a stream of ticks of a rule, which goes on with the clock that hands and joints have."""
        topics, check = pairing.topics(self._robot.hand_names), range_check(self._robot)
        stream = TickStream(
            topics,
            [reader_of(topic, check) for topic in topics],
            reject=reject,
            restart=lambda stamp, _reason: stream.begin(stamp),
        )
        return stream


def _completed(stream: TickStream, record: RecordedMessage) -> list[tuple[int, Parts]]:
    """Return the tick that a message completes, if it does; messages on other topics are passed over."""
    tick = stream.take(record) if record.topic in stream else None
    if tick is None:
        return []
    stream.order.last_ns = tick[0]
    stream.order.note_answer()
    return [tick]
