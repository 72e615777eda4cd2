"""A recorded session as a stream: the learner's messages and the phase markers, as they were recorded."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice

from recorders.cdr.codec import decode
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.errors import LogError
from recorders.messages.message_types import String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, SESSION_PHASE
from recorders.protocol.stream import Offer
from recorders.reading.parts import Log
from replay.sources.schedule import Schedule
from replay.sources.scheduled import check_size, naming, read_robot, renamed

_NO_RENAMES: Mapping[str, str] = {}


class RecordedSession:
    """The stream of one recorded session, live or replayed.

    Parameters
    ----------
    path : Path, Parts or Reader
        A log or a session in parts, with phase markers.
    epochs : int, optional
        How many epochs the session had; needed if the log does not state it, as the rates fall over them.
    renames : mapping of str to str
        Our topic names for those that the log uses.
    topics : tuple of str, optional
        Topics that are presented; if left out, those that the log states, or targets and joints.

    Attributes
    ----------
    run : str
        The run that the markers name.

    Raises
    ------
    LogError
        If the log cannot be read, has no markers or those of several runs, or the number of epochs is unknown.
    """

    def __init__(
        self,
        path: Opened,
        *,
        epochs: int | None = None,
        renames: Mapping[str, str] = _NO_RENAMES,
        topics: tuple[str, ...] | None = None,
    ) -> None:
        self._reader = open_log(path)
        self.path = self._reader.path
        self._renames = dict(renames)
        self._robot = read_robot(self._reader)
        topics = topics or stated_topics(self._reader) or COMMANDED_TICK
        self._topics = frozenset({SESSION_PHASE, *topics})
        self._count, runs = 0, list[str]()
        for message in self.stream():
            self._count += 1
            check_size(message, self.path)
            if message.topic == SESSION_PHASE:
                runs.append(_phase(self.path, message).run)
        if len(set(runs)) != 1:
            found = f"those of {len(set(runs))}" if runs else "none"
            raise LogError(f"{self.path}: expected the phase markers of one recorded run, found {found}")
        self.run = runs[0]
        self.schedule = self._find_schedule(epochs, topics).to_dict()

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""
        return Offer(
            run=self.run,
            schedule=self.schedule,
            logs=[{"name": self.path.name}],
            robot=self._robot,
            messages=self._count,
        )

    def __len__(self) -> int:
        """Messages of the stream."""
        return self._count

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages in the order of the file, from index `start` on."""
        return islice(renamed(self._reader, self._renames, self._topics, file_order=True), start, None)

    def _find_schedule(self, epochs: int | None, topics: tuple[str, ...]) -> Schedule:
        if epochs is not None:
            return Schedule(epochs, topics=topics)
        recorded = self._reader.manifest.get("schedule")
        if not isinstance(recorded, dict):
            raise LogError(f"{self.path}: the log does not state how many epochs the session had; give --epochs")
        return replace(Schedule.from_dict(recorded), topics=topics)


def stated_topics(reader: Reader) -> tuple[str, ...] | None:
    """Return the topics of a tick of the stream that a log is a recording of; None if the log does not state them.

    Raises
    ------
    ConfigError
        If what it states is no schedule.
    """
    recorded = reader.manifest.get("schedule")
    if not isinstance(recorded, dict):
        return None
    return Schedule.from_dict(recorded).topics if "topics" in recorded else COMMANDED_TICK


def _phase(path: Log, message: RecordedMessage) -> Phase:
    with naming(path):
        marker = decode(message.type, message.data)
        if not isinstance(marker, String):
            raise LogError(
                f"{path}: {message.topic} #{message.sequence}: expected {String.TYPE}, found {message.type!r}"
            )
        return Phase.from_message(marker)
