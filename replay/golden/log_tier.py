"""The logs of a golden case: cut down to what the case needs, and checked message by message against digests."""

import hashlib
import struct
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.errors import LogError
from recorders.files.anonymous_file import write_whole
from recorders.files.whole_files import file_sha256
from recorders.messages.topics import (
    COMMANDED_TICK,
    SAMPLE_JOINTS,
    SESSION_PHASE,
    hand_measured,
    hand_target,
    hands_among,
)
from recorders.reading.reader import LogReader
from recorders.writing.writer import RESERVED, LogWriter
from replay.golden.finding import LOG, Finding, error_text
from replay.sources.stream_digest import frame_for_digest

_OTHERS = (SAMPLE_JOINTS, SESSION_PHASE)

_KEY = struct.Struct("<BIQ")  # place of the topic above, sequence, first bytes of the digest
_MESSAGE = "message"


@dataclass(frozen=True)
class LogEntry:
    """A case's record of one of its logs: name, SHA-256 of the file, of its ticks, and of its attachments."""

    name: str
    sha256: str
    ticks_sha256: str
    attachments: dict[str, str]

    def to_dict(self) -> dict[str, object]:
        """Return the entry for JSON."""
        return asdict(self)


class _Key(NamedTuple):
    """A message in brief; two keys are equal if the messages are."""

    topic: int
    sequence: int
    digest: int


def strip_topics(
    source: Opened, target: Path, *, physics: bool, tick: tuple[str, ...] = COMMANDED_TICK, file_order: bool = False
) -> None:
    """Copy a log with the topics that a case needs; one that was cut down before is copied to the byte.

    Parameters
    ----------
    source : Path, Parts or Reader
        The log, or a session in parts, which becomes one log.
    target : Path
        Where the copy goes.
    physics : bool
        Whether targets and the hands as measured are needed, whatever the learner takes.
    tick : tuple of str
        Topics that the learner takes.
    file_order : bool
        Whether the order of the file counts, and not that of the log times.

    Raises
    ------
    LogError
        If the log cannot be read, or the copy cannot be written.
    """
    reader = open_log(source)
    of_case = [topic for topic in reader.topics if topic in _OTHERS or hands_among([topic])]
    if isinstance(reader, LogReader) and isinstance(source, Path) and len(of_case) == len(reader.topics):
        write_whole(target, source.read_bytes())
        return
    topics = of_case if physics else (SESSION_PHASE, *tick)
    manifest = {key: value for key, value in reader.manifest.items() if key not in RESERVED}
    attachments = {name: reader.attachment(name) for name in reader.attachments}
    with LogWriter(target, manifest=manifest, attachments=attachments) as writer:
        for record in reader.records(topics=topics, file_order=file_order):
            writer.copy(record)


def describe(path: Path, *, ticks_sha256: str) -> LogEntry:
    """Return what a case keeps of a log; raises LogError if it cannot be read."""
    return LogEntry(path.name, file_sha256(path), ticks_sha256, _attachments(LogReader(path)))


class LogIndex:
    """A short digest for each message of a log, in file order, on the topics that a case keeps.

    Parameters
    ----------
    tick : sequence of str
        Topics that the learner takes, of which the hands are known.
    """

    def __init__(self, tick: Sequence[str]) -> None:
        hands = hands_among(tick)
        self.topics = (*map(hand_target, hands), *_OTHERS, *map(hand_measured, hands))

    def of(self, path: Path) -> bytes:
        """Return the digests of a log; raises LogError if it cannot be read."""
        return b"".join(_KEY.pack(*key) for key in self._found(path))

    def check(self, name: str, indexed: bytes) -> None:
        """Check a file of what `of` returned; raises LogError if it is not whole messages of known topics."""
        if len(indexed) % _KEY.size or any(key.topic >= len(self.topics) for key in _keys(indexed)):
            raise LogError(f"{name}: expected entries of {_KEY.size} bytes of known topics, found others")

    def first_change(self, path: Path, entry: LogEntry, indexed: bytes) -> Finding | None:
        """Return the first change of a log since the case was added."""
        if file_sha256(path) == entry.sha256:
            return None
        try:
            return self._altered_message(path, _keys(indexed)) or _altered_rest(path, entry)
        except Exception as error:
            return Finding(LOG, "file", "an undamaged log", error_text(error), {"log": entry.name})

    def _altered_message(self, path: Path, expected: Sequence[_Key]) -> Finding | None:
        found = self._found(path)
        seen: set[_Key] = set()
        for place, key in enumerate(expected):
            if (other := next(found, None)) != key:
                return self._parted(path.name, key, other, seen, expected[place + 1 :])
            seen.add(key)
        extra = next(found, None)
        return None if extra is None else self._finding(path.name, extra, "absent", "present", "extra")

    def _parted(self, log: str, key: _Key, other: _Key | None, seen: set[_Key], later: Sequence[_Key]) -> Finding:
        if other is None or other in later:
            return self._finding(log, key, "present", "absent", "missing, or moved")
        if other in seen:
            return self._finding(log, other, "once", "again", "repeated")
        if other[:2] == key[:2]:
            return self._finding(log, key, f"digest {key.digest:016x}", f"{other.digest:016x}", "changed")
        return self._finding(log, other, "absent", "present", "extra")

    def _finding(self, log: str, key: _Key, expected: str, found: str, note: str) -> Finding:
        place: dict[str, str | int] = {"log": log, "topic": self.topics[key.topic], "sequence": key.sequence}
        return Finding(LOG, _MESSAGE, expected, found, place, note)

    def _found(self, path: Path) -> Iterator[_Key]:
        for record in LogReader(path).records(topics=self.topics, file_order=True):
            digest = hashlib.sha256(frame_for_digest(record)).digest()
            place = self.topics.index(record.topic)
            yield _Key(place, record.sequence, int.from_bytes(digest[:8], "little"))


def _keys(indexed: bytes) -> list[_Key]:
    return [_Key(*fields) for fields in _KEY.iter_unpack(indexed)]


def _altered_rest(path: Path, entry: LogEntry) -> Finding:
    """Name what differs in a log whose messages do not."""
    attachments = _attachments(LogReader(path))
    for name in {**entry.attachments, **attachments}:
        expected, found = entry.attachments.get(name, "absent"), attachments.get(name, "absent")
        if expected != found:
            return Finding(LOG, f"attachment {name}", f"SHA-256 {expected}", found, {"log": entry.name})
    return Finding(
        LOG, "file", f"SHA-256 {entry.sha256}", file_sha256(path), {"log": entry.name}, "its messages are the same"
    )


def _attachments(reader: Reader) -> dict[str, str]:
    return {name: hashlib.sha256(reader.attachment(name)).hexdigest() for name in reader.attachments}
