"""The joiner of ticks: messages of several topics, joined exactly on their stamp, however they arrive."""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeAlias, TypeVar

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage

_Value = TypeVar("_Value")

OpenTick: TypeAlias = Sequence[tuple[RecordedMessage, Any] | None]
"""Messages of one stamp and what was read of each, in the order of the topics; None for those that have not come."""

GiveUp: TypeAlias = Callable[[int, OpenTick, str], None]
"""Takes the stamp of a tick that can hardly become complete [ns], what there is of it, and why it is given up."""


class RejectionError(MessageError):
    """A message is rejected; `kind` is the reason in a word or two."""

    def __init__(self, kind: str, line: str) -> None:
        super().__init__(line)
        self.kind = kind


class StampJoiner(Generic[_Value]):
    """Joins messages with the same stamp to ticks, and lets incomplete ones wait.

    Topics may run ahead of one another. A tick that waits is given up when a later one is complete, as on each topic
    messages come in order, or when too many wait: then the one that came first, as a stamp far ahead must not push out
    what is due. What a reader of ticks demands beyond that, and what it makes of one that is given up, is its own.

    Parameters
    ----------
    topics : sequence of str
        The topics of a tick; a message is known by the rank of its topic among them.
    limit : int
        How many ticks may wait: a publisher that stays silent must not fill the memory.
    give_up : callable
        Called for each tick that is given up, while it still waits; if it raises, the tick waits on.

    Attributes
    ----------
    open : dict of int to list
        Ticks that wait, by stamp [ns], in order of arrival; to be read only.
    """

    def __init__(self, topics: Sequence[str], *, limit: int, give_up: GiveUp) -> None:
        self._topics = tuple(topics)
        self._limit = limit
        self._give_up = give_up
        self._nothing: list[tuple[RecordedMessage, _Value] | None] = [None] * len(self._topics)
        self.open: dict[int, list[tuple[RecordedMessage, _Value] | None]] = {}

    def add(
        self, stamp_ns: int, rank: int, record: RecordedMessage, value: _Value
    ) -> list[tuple[RecordedMessage, _Value]] | None:
        """Take in a message, and return the messages and values of its tick if that is complete now.

        Raises
        ------
        RejectionError
            If a message of this topic and stamp waits already.
        """
        tick = self.open.get(stamp_ns)
        if tick is None:
            tick = self._begin(stamp_ns, record)
        elif tick[rank] is not None:
            line = f"{name_of(record)}: a second message at {stamp_ns} ns, expected one per tick"
            raise RejectionError("repeated", line)
        tick[rank] = record, value
        if None in tick:
            return None
        del self.open[stamp_ns]
        if self.open:
            self._give_up_before(stamp_ns)
        return tick  # type: ignore[return-value]  # None is none of them

    def waiting(self) -> list[tuple[int, OpenTick]]:
        """Return the stamps that wait [ns], the smallest first, and what there is of their ticks."""
        return sorted(self.open.items(), key=lambda item: item[0])

    def absent(self, tick: OpenTick) -> list[str]:
        """Return the topics of which a tick lacks a message."""
        return [topic for topic, part in zip(self._topics, tick, strict=True) if part is None]

    def clear(self) -> None:
        """Forget the ticks that wait."""
        self.open.clear()

    def _begin(self, stamp_ns: int, record: RecordedMessage) -> list[tuple[RecordedMessage, _Value] | None]:
        if len(self.open) >= self._limit:
            first = next(iter(self.open))
            self._give_up(first, self.open[first], f"{name_of(record)} is {self._limit} ticks ahead of it")
            del self.open[first]
        tick = self.open[stamp_ns] = self._nothing.copy()
        return tick

    def _give_up_before(self, stamp_ns: int) -> None:
        for earlier in sorted(stamp for stamp in self.open if stamp < stamp_ns):
            self._give_up(earlier, self.open[earlier], f"the tick at {stamp_ns} ns is complete")
            del self.open[earlier]


def name_of(record: RecordedMessage) -> str:
    """Return how a message is named in an error: its topic and its number there."""
    return f"{record.topic} #{record.sequence}"
