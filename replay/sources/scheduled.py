"""The replay engine: logs and a training schedule become one ordered stream of messages and phase markers."""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, count, islice, pairwise
from typing import Any

from recorders.cdr.codec import decode_as, encode
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.errors import JointError, LogError, MessageError, MotionError
from recorders.messages.message_types import String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, ROBOT_TEXTS, SESSION_PHASE, TOPICS, type_of
from recorders.protocol.stream import MAX_MESSAGE, Offer
from recorders.reading.parts import Log
from recorders.text.wording import names_text
from recorders.ticks.joiner import TickJoiner
from replay.sources.episodes import ALIGNMENT, WHOLE, Span, alignment_of, episode_spans
from replay.sources.schedule import Schedule
from replay.sources.stream_digest import StreamDigest

CACHE_BYTES = 64 << 20
"""A log whose messages take less is held in memory, since every cycle presents it again."""

ROBOT_FILES = {"toml": "robot.toml", "urdf": "robot.urdf"}

_NO_RENAMES: Mapping[str, str] = {}


class EpisodeLog:
    """The ticks of one log, read once or as often as they are asked for.

    Parameters
    ----------
    path : Path, Parts or Reader
        A log, or a session in parts.
    renames : mapping of str to str
        Our topic names for those that the log uses, so that a log recorded by others trains; those of topics that it
        does not have count for nothing.
    tick : tuple of str
        Topics that a tick has a message of each, by our names.
    span : Span
        The part of the log that is the episode; all of it if left out.

    Attributes
    ----------
    topics : tuple of str
        All topics of the log, by its own names.
    count : int
        How many messages a presentation has.
    digest : str
        SHA-256 over the ticks in canonical order, hexadecimal: the log as the learner sees it.
    robot : dict
        `toml` and `urdf` of the robot, as the log carries them; empty if it carries none.

    Raises
    ------
    LogError
        If the log cannot be read, is a recorded session, or lacks a topic that the learner needs.
    MessageError
        If a message is not what it should be, or a tick is not complete.
    """

    def __init__(
        self,
        path: Opened,
        *,
        renames: Mapping[str, str] = _NO_RENAMES,
        tick: tuple[str, ...] = COMMANDED_TICK,
        span: Span = WHOLE,
    ) -> None:
        self._tick, self._span = tick, span
        self._reader = open_log(path)
        self.path = self._reader.path
        self.topics = tuple(self._reader.topics)
        self._renames = {foreign: ours for foreign, ours in renames.items() if foreign in self.topics}
        self.robot = read_robot(self._reader)
        self._cache: list[RecordedMessage] | None = []
        self._survey()

    def __iter__(self) -> Iterator[RecordedMessage]:
        """Yield the messages in log order."""
        return iter(self._cache) if self._cache is not None else self._read()

    @property
    def alignment(self) -> dict[str, Any]:
        """Account of how the log was aligned, under this name, if it was; of its first episode alone."""
        account = alignment_of(self._reader) if self._span.start_ns == 0 else None
        return {} if account is None else {ALIGNMENT: account}

    @property
    def retained(self) -> bool:
        """Whether the messages are in memory."""
        return self._cache is not None

    def _read(self) -> Iterator[RecordedMessage]:
        return renamed(self._reader, self._renames, self._tick, span=self._span)

    def _survey(self) -> None:
        """Read the log through once: check, count and hash it and, if it is small, keep it."""
        self._check_topics()
        digest, joiner, size = StreamDigest(), TickJoiner(topics=self._tick), 0
        self.count = 0
        for message in self._read():
            check_size(message, self.path)
            with naming(self.path):
                for tick in joiner.feed(message):
                    digest.update(tick.records)
            self.count += 1
            size += len(message.data)
            if self._cache is not None:
                self._cache.append(message)
            if size > CACHE_BYTES:
                self._cache = None
        with naming(self.path):
            joiner.finish()
        self.digest = digest.hexdigest()

    def _check_topics(self) -> None:
        there = set(self._reader.counts)
        found = {self._renames.get(topic, topic) for topic in there}
        missing = [topic for topic in self._tick if topic not in found]
        if missing:
            others = names_text(self._nameable(there, missing))
            choice = f", or rename with --map one of {others}" if others else "; it has no other topic to rename"
            raise LogError(
                f"{self.path}: expected messages on {names_text(missing)}, found none; record with explore{choice}"
            )
        if SESSION_PHASE in found and alignment_of(self._reader) is None:
            raise LogError(f"{self.path}: a recorded session, with phase markers of its own; use --as-recorded")

    def _nameable(self, there: Collection[str], missing: Collection[str]) -> list[str]:
        """Return the topics that are neither ours nor renamed already, and may be of the type of a missing one."""
        free = set(there) - set(self._tick) - self._renames.keys()
        types, found = {"", *map(type_of, missing)}, self._reader.topics
        return sorted(topic for topic in free if found.get(topic, "") in types)


def renamed(
    reader: Reader,
    renames: Mapping[str, str],
    topics: Collection[str],
    *,
    file_order: bool = False,
    span: Span = WHOLE,
) -> Iterator[RecordedMessage]:
    """Yield the messages of a log on some topics, by our names for them, those without a type as of our topic's.

    Parameters
    ----------
    reader : Reader
        The log.
    renames : mapping of str to str
        Our topic names for those that the log uses.
    topics : collection of str
        The topics, by our names.
    file_order : bool
        Whether they come in the order of the file, and not of log time.
    span : Span
        Log times that are wanted.

    Raises
    ------
    LogError
        If the log cannot be read, has no topic of a name that is to be replaced, or one of another type than our topic.
    """
    start_ns, end_ns = span
    if not renames:
        yield from map(typed, reader.records(topics=topics, start_ns=start_ns, end_ns=end_ns, file_order=file_order))
        return
    check_renames(renames, reader.topics, where=str(reader.path))
    _check_types(renames, reader.topics, where=str(reader.path))
    for record in reader.records(start_ns=start_ns, end_ns=end_ns, file_order=file_order):
        topic = renames.get(record.topic, record.topic)
        if topic in topics:
            yield typed(record._replace(topic=topic))


def check_size(record: RecordedMessage, path: Log, *, hint: str = "") -> None:
    """Raise LogError if a message is larger than those that travel: better at the start than in the middle."""
    if len(record.data) > MAX_MESSAGE:
        raise LogError(
            f"{path}: {record.topic} #{record.sequence}: expected at most {MAX_MESSAGE} bytes in a message, "
            f"found {len(record.data)}{hint}"
        )


def typed(record: RecordedMessage) -> RecordedMessage:
    """Return a message with the type of its topic in the table of topics, if its writer has named none."""
    return record if record.type else record._replace(type=type_of(record.topic))


def check_renames(renames: Mapping[str, str], topics: Collection[str], *, where: str) -> None:
    """Check that there is a topic for every name that is to be replaced: a slip of the pen would else change nothing.

    Raises
    ------
    LogError
        If there is none; the line names those that there are, and the log or logs, `where`.
    """
    if unknown := sorted(renames.keys() - set(topics)):
        found = names_text(sorted(set(topics) - renames.keys())) or "none"
        raise LogError(f"{where}: --map: expected a topic {names_text(unknown)}, found none; there are: {found}")


def _check_types(renames: Mapping[str, str], topics: Mapping[str, str], *, where: str) -> None:
    for foreign, ours in sorted(renames.items()):
        if (found := topics[foreign]) and type_of(ours) not in ("", found):
            raise LogError(
                f"{where}: --map {foreign}={ours}: expected a topic of {type_of(ours)}, found one of {found[:80]!r}"
            )


def read_robot(reader: Reader) -> dict[str, str]:
    """Return `toml` and `urdf` of the robot that a log carries; empty if it lacks one, as another recorder's does.

    They are attachments, or else what a robot published of itself last.

    Raises
    ------
    LogError
        If they are not text.
    """
    if set(ROBOT_FILES.values()) <= set(reader.attachments):
        texts = {key: reader.attachment(name) for key, name in ROBOT_FILES.items()}
    elif all(reader.counts.get(topic, 0) for topic in ROBOT_TEXTS.values()):
        texts = {key: _last_text(reader, topic) for key, topic in ROBOT_TEXTS.items()}
    else:
        return {}
    try:
        return {key: text.decode() for key, text in texts.items()}
    except UnicodeDecodeError as error:
        raise LogError(f"{reader.path}: expected the robot's files to be UTF-8 text, found other bytes") from error


def _last_text(reader: Reader, topic: str) -> bytes:
    *_, last = reader.records(topics=(topic,))
    try:
        return decode_as(String, last.data).data.encode()
    except MessageError as error:
        raise LogError(f"{reader.path}: {topic}: {error}") from error


@contextmanager
def naming(path: Log) -> Iterator[None]:
    """Put the log's path before what is wrong with one of its messages, and behind it whether its log times fall."""
    try:
        yield
    except (MessageError, JointError, MotionError) as error:
        raise type(error)(f"{path}: {error}{_order_note(path)}") from error


def _order_note(path: Log) -> str:
    """Return what to know of a log whose messages do not follow one another in log time; nothing for any other."""
    try:
        reader = open_log(path)
        times_ns = (record.log_time_ns for record in reader.records(file_order=True))
        falls = not reader.by_file and any(later < earlier for earlier, later in pairwise(times_ns))
    except LogError:
        return ""
    if not falls:
        return ""
    return (
        "; log times fall in the order of the file, as of a clock that stepped back, and messages are taken by them: "
        "`reenact train --as-live` goes by the file"
    )


class Replay:
    """One run: every message that a schedule makes of some logs, by index.

    Parameters
    ----------
    paths : sequence of Path, Parts or Reader
        Logs; a cycle presents them in this order, each under a phase marker of its own.
    schedule : Schedule
        Epochs and phases, and topics of a tick.
    renames : mapping of str to str
        Our topic names for those that the logs use.

    Raises
    ------
    LogError
        If there is no log, one cannot be read, the logs are of different robots, or none of them has a topic that is to
        be renamed.
    MessageError
        If a message is not what it should be.
    """

    def __init__(
        self, paths: Sequence[Opened], schedule: Schedule, *, renames: Mapping[str, str] = _NO_RENAMES
    ) -> None:
        if not paths:
            raise LogError("expected at least one log, found none")
        self.schedule = schedule
        self.episodes = [
            EpisodeLog(path, renames=renames, tick=schedule.topics, span=span)
            for path in map(open_log, paths)
            for span in episode_spans(path, schedule.topics)
        ]
        self.robot = self.episodes[0].robot
        for episode in self.episodes[1:]:
            if episode.robot != self.robot:
                raise LogError(f"{episode.path}: recorded with another robot than {self.episodes[0].path}")
        topics = {topic for episode in self.episodes for topic in episode.topics}
        check_renames(renames, topics, where=names_text(str(path) for path in paths))
        digests = [episode.digest for episode in self.episodes]
        self.run = hashlib.sha256(json.dumps([schedule.to_dict(), digests]).encode()).hexdigest()[:32]

    def __len__(self) -> int:
        """Messages of the whole run, phase markers included."""
        return self.schedule.epochs * self.schedule.cycles * sum(1 + episode.count for episode in self.episodes)

    @property
    def retained(self) -> bool:
        """Whether all the logs are in memory."""
        return all(episode.retained for episode in self.episodes)

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""
        return Offer(
            run=self.run,
            schedule=self.schedule.to_dict(),
            logs=[
                {"name": episode.path.name, "ticks_sha256": episode.digest} | episode.alignment
                for episode in self.episodes
            ],
            robot=self.robot,
            messages=len(self),
        )

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages of the run from index `start` on; presentations before it are not read."""
        index = 0
        for marker, episode in self.presentations():
            end = index + 1 + episode.count
            if end > start:
                skip = max(0, start - index)
                yield from islice(chain((marker,), episode), skip, None)
            index = end

    def presentations(self) -> Iterator[tuple[RecordedMessage, EpisodeLog]]:
        """Yield the phase marker of every presentation, and the log that is presented under it."""
        number = count()
        for epoch in range(self.schedule.epochs):
            for cycle, phase in self.schedule.cycles_of_epoch():
                for episode in self.episodes:
                    data = encode(Phase(self.run, epoch, cycle, phase, episode.digest).to_message())
                    marker = RecordedMessage(
                        SESSION_PHASE, TOPICS[SESSION_PHASE].type, data, next(number), log_time_ns=0
                    )
                    yield marker, episode
