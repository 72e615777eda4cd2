"""Choice of the ticks that a live learner takes: those of its pairs, or those of the pairs in their place."""

from collections.abc import Callable, Collection
from typing import Generic, TypeAlias, TypeVar

from recorders.messages.record import RecordedMessage
from recorders.ticks.live import WAIT_TICKS
from replay.sources.live import LiveStream

_Stream = TypeVar("_Stream", bound=LiveStream)

Records: TypeAlias = tuple[RecordedMessage, ...]

_MAX_HELD = 4096  # messages held back: markers without ticks must not fill the memory


class LiveChoice(Generic[_Stream]):
    """A live stream of ticks on some topics, or on those in their place if no such tick comes.

    Until one of the former is complete, or `WAIT_TICKS` of the latter are, both streams are fed and nothing of either
    goes on; then all of the one that is chosen does. So the choice costs no tick.

    Parameters
    ----------
    make : callable
        Makes a `LiveStream` of ticks on some topics.
    tick : tuple of str
        Topics of a tick.
    otherwise : tuple of str
        Topics of a tick in its place; those of `tick` where there is no choice.

    Attributes
    ----------
    stream : LiveStream
        The stream that is chosen, or likely to be.
    tick : tuple of str
        Topics of its ticks.
    """

    def __init__(
        self, make: Callable[[tuple[str, ...]], _Stream], tick: tuple[str, ...], otherwise: tuple[str, ...]
    ) -> None:
        self.stream, self.tick = make(tick), tick
        self._other: _Stream | None = None
        if otherwise != tick:
            self._other, self._other_tick = make(otherwise), otherwise
            self._other.quiet = True
        self._held: list[RecordedMessage] = []
        self._other_held: list[RecordedMessage] = []

    @property
    def ticks(self) -> int:
        """Ticks of the stream that is chosen, or those held back."""
        return self.stream.ticks or (0 if self._other is None else self._other.ticks)

    def feed(self, record: RecordedMessage, *, numbered: bool = True) -> Records:
        """Take in a message and return what goes on with it, as `LiveStream.feed` does."""
        found = self.stream.feed(record, numbered=numbered)
        if self._other is None:
            return found
        self._held += found
        self._other_held += self._other.feed(record, numbered=numbered)
        held = max(len(self._held), len(self._other_held))
        if self.stream.ticks or self._other.ticks >= WAIT_TICKS or held >= _MAX_HELD:
            return self.settle()
        return ()

    def settle(self, topics: Collection[str] | None = None) -> Records:
        """Choose now, by the topics of the stream that is to come, or else by the ticks so far; return what goes on."""
        if self._other is None:
            return ()
        lacks = self.stream.ticks == 0 and self._other.ticks > 0
        if topics is not None:
            lacks = not set(self.tick) <= set(topics)
        held = self._held
        if lacks:
            self.stream, self.tick, held = self._other, self._other_tick, self._other_held
            self.stream.quiet = False
        self._other, self._held, self._other_held = None, [], []
        return tuple(held)
