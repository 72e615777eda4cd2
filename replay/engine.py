"""The replay engine: logs and a training schedule become one ordered stream of messages and phase markers."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from recorders.cdr import encode
from recorders.errors import LogError
from recorders.phase import Phase
from recorders.reader import LogReader
from recorders.records import Stamped
from recorders.stream import Offer
from recorders.topics import LEARNER_TOPICS, SESSION_PHASE, TOPICS
from replay.digests import framed
from replay.schedule import Schedule

CACHE_BYTES = 64 << 20
"""A log whose messages take less is kept in memory, since every cycle presents it again."""

ROBOT_FILES = {"toml": "robot.toml", "urdf": "robot.urdf"}


class Episode:
    """The messages of one log that a learner is fed, read once or as often as they are asked for.

    Parameters
    ----------
    path : Path
        A log.

    Attributes
    ----------
    count : int
        How many messages a presentation has.
    content : str
        SHA-256 over these messages, hexadecimal.
    robot : dict
        `toml` and `urdf` of the robot, as the log carries them; empty if it carries none.

    Raises
    ------
    LogError
        If the log cannot be read, or lacks a topic that the learner needs.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reader = LogReader(path)
        self._topics = [topic.name for topic in LEARNER_TOPICS]
        self.robot = self._robot()
        self._cache: list[Stamped] | None = []
        self._survey()

    def __iter__(self) -> Iterator[Stamped]:
        """Yield the messages in log order."""
        return iter(self._cache) if self._cache is not None else self._read()

    def _read(self) -> Iterator[Stamped]:
        return self._reader.records(topics=self._topics)

    def _robot(self) -> dict[str, str]:
        """Return the robot's files; none if the log lacks one of them, as another recorder's does."""
        if not set(ROBOT_FILES.values()) <= set(self._reader.attachments):
            return {}
        return {key: _text(self._reader, name) for key, name in ROBOT_FILES.items()}

    def _survey(self) -> None:
        """Read the log through once: count, hash and, if it is small, keep it."""
        content, size, found = hashlib.sha256(), 0, set()
        self.count = 0
        for message in self._read():
            content.update(framed(message))
            found.add(message.topic)
            self.count += 1
            size += len(message.data)
            if self._cache is not None:
                self._cache.append(message)
            if size > CACHE_BYTES:
                self._cache = None
        self.content = content.hexdigest()
        missing = [topic for topic in self._topics if topic not in found]
        if missing:
            raise LogError(f"{self.path}: expected messages on {', '.join(missing)}, found none; record with explore")


def _text(reader: LogReader, name: str) -> str:
    try:
        return reader.attachment(name).decode()
    except UnicodeDecodeError as error:
        raise LogError(f"{reader.path}: expected attachment {name} to be UTF-8 text, found other bytes") from error


class Replay:
    """One run: every message that a schedule makes of some logs, by index.

    Parameters
    ----------
    paths : sequence of Path
        Logs; a cycle presents them in this order, each under a phase marker of its own.
    schedule : Schedule
        Epochs and phases.

    Raises
    ------
    LogError
        If a log cannot be read, or the logs are of different robots.
    """

    def __init__(self, paths: Sequence[Path], schedule: Schedule) -> None:
        self.schedule = schedule
        self.episodes = [Episode(path) for path in paths]
        self.robot = self.episodes[0].robot
        for episode in self.episodes[1:]:
            if episode.robot != self.robot:
                raise LogError(f"{episode.path}: recorded with another robot than {self.episodes[0].path}")
        contents = [episode.content for episode in self.episodes]
        self.run = hashlib.sha256(json.dumps([schedule.to_dict(), contents]).encode()).hexdigest()[:32]

    def __len__(self) -> int:
        """Messages of the whole run, phase markers included."""
        return self.schedule.epochs * self.schedule.cycles * sum(1 + episode.count for episode in self.episodes)

    def offer(self) -> Offer:
        """Return what the consumers are told before the first message."""
        return Offer(
            run=self.run,
            schedule=self.schedule.to_dict(),
            logs=[{"name": episode.path.name, "content_sha256": episode.content} for episode in self.episodes],
            robot=self.robot,
        )

    def stream(self, start: int = 0) -> Iterator[Stamped]:
        """Yield the messages of the run from index `start` on; presentations before it are not read."""
        index = 0
        for number, (marker, episode) in enumerate(self._presentations()):
            end = index + 1 + episode.count
            if end > start:
                yield from self._presentation(number, marker, episode, skip=max(0, start - index))
            index = end

    def _presentations(self) -> Iterator[tuple[Phase, Episode]]:
        for epoch in range(self.schedule.epochs):
            for cycle, phase in self.schedule.epoch():
                for episode in self.episodes:
                    yield Phase(self.run, epoch, cycle, phase, episode.content), episode

    @staticmethod
    def _presentation(number: int, marker: Phase, episode: Episode, *, skip: int) -> Iterator[Stamped]:
        messages = iter(episode)
        if skip == 0:
            data = encode(marker.to_message())
            yield Stamped(SESSION_PHASE, TOPICS[SESSION_PHASE].type, data, number, log_time_ns=0)
        for _ in range(skip - 1):
            next(messages)
        yield from messages
