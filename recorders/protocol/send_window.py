"""State of the stream that a sender has under way: a machine of pure steps, without Zenoh, threads or a clock."""

from collections import deque

from recorders.protocol.frames import Frame, FrameType
from recorders.protocol.stream import WINDOW_BYTES, Progress, is_acknowledged


class Rewind(Exception):
    """A consumer wants the stream from an index that is behind."""

    def __init__(self, index: int) -> None:
        self.index = index


class SendWindow:
    """Frames that are not acknowledged by every consumer yet, and how far each consumer is.

    Whoever drives it sends what it adds, and what `missing` returns, and notes what the consumers answer.

    Parameters
    ----------
    run : str
        The run that is sent; progress of any other counts for nothing.
    window : int
        How many messages may be under way unacknowledged; beside less than half of it, one more frame may.

    Attributes
    ----------
    progress : dict of str to Progress
        What is known of the consumers that acknowledge, by name.
    sent : int
        Stream index up to which everything was sent.
    """

    def __init__(self, run: str, window: int) -> None:
        self._run = run
        self._window = window
        self._frames: deque[Frame] = deque()
        self._sizes: deque[int] = deque()  # of them [bytes]
        self._bytes = 0  # of all of them: of what lies between `consumed` and `sent`
        self._furthest = 0  # what was ever sent
        self.progress: dict[str, Progress] = {}
        self.sent = 0

    @property
    def consumed(self) -> int:
        """The index up to which every consumer has consumed; everything, if nobody is awaited."""
        return min((progress.next for progress in self.progress.values()), default=self.sent)

    @property
    def through(self) -> bool:
        """Whether every consumer has reported its result."""
        return all(progress.result is not None for progress in self.progress.values())

    def start(self) -> int:
        """Return the index from which the consumers together want the stream."""
        return min((progress.next for progress in self.progress.values()), default=0)

    def begin(self, index: int) -> None:
        """Begin, or begin again, at an index: nothing is under way."""
        self._frames.clear()
        self._sizes.clear()
        self._bytes = 0
        self.sent = index

    def add(self, frame: Frame) -> None:
        """Note a frame that is sent now."""
        self._frames.append(frame)
        self._sizes.append(frame.size)
        self._bytes += self._sizes[-1]
        self.sent = frame.end
        self._furthest = max(self._furthest, self.sent)
        self.discard_consumed()  # where nobody is awaited, this very frame

    def has_room(self, count: int, size: int) -> bool:
        """Whether so many more messages, of so many bytes together, may be under way.

        They always may while less is under way than consumers acknowledge: no acknowledgement would make more room.
        """
        under_way = self.sent - self.consumed
        if under_way + count <= self._window and self._bytes + size <= WINDOW_BYTES:
            return True
        return not is_acknowledged(under_way, self._bytes, self._window)

    def discard_consumed(self) -> int:
        """Forget what every consumer has consumed, and return the index up to which that is."""
        consumed, frames = self.consumed, self._frames
        while frames and frames[0].end <= consumed and frames[0].kind is not FrameType.END:
            frames.popleft()
            self._bytes -= self._sizes.popleft()
        if frames and frames[0].first < consumed < frames[0].end:  # consumers, too, count from there on
            frames[0] = frames[0].from_index(consumed)
            self._bytes += frames[0].size - self._sizes[0]
            self._sizes[0] = frames[0].size
        return consumed

    def note(self, name: str, progress: Progress) -> bool:
        """Take over a consumer's progress; False if it is of another run, or no more than what is known."""
        known = self.progress.get(name)
        news = known is not None and progress.run == self._run and progress.next >= known.next and not known.is_final
        if news:
            self.progress[name] = progress
            self.discard_consumed()
        return news

    def can_be(self, progress: Progress) -> bool:
        """Whether a consumer can be that far: anyone may publish in its name."""
        return progress.received <= self._furthest

    def lacks(self, answer: Progress) -> bool:
        """Whether a consumer lacks something that was sent.

        Once everything has arrived, it may take its time to consume it; then it lacks the end until there is a result.
        """
        sent_end = bool(self._frames) and self._frames[-1].kind is FrameType.END
        return answer.received < self.sent or (sent_end and answer.next == self.sent)

    def missing(self, name: str, answer: Progress) -> list[Frame]:
        """Return the frames to send to a consumer again.

        Raises
        ------
        Rewind
            If they are not here any longer, as others have acknowledged them: they are to come from the stream itself.
        """
        if self._frames and self._frames[0].first > answer.received:
            self.progress[name] = answer
            raise Rewind(answer.received)
        return [frame for frame in self._frames if frame.end > answer.received or frame.kind is FrameType.END]
