"""Messages of a served controller's topics, joined to ticks: checked one by one, in the order of their stamps."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from pipeline.serving.clock_reset import StampOrder
from pipeline.serving.inputs import JointsReader, TargetReader
from pipeline.serving.rejections import Rejection
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import is_measured
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
