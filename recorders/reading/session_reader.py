"""Reads a recording in several files as if it were in one: the same messages in the same order."""

import heapq
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial
from itertools import chain
from typing import Any, TypeAlias

from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import PART, Parts
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.reader import LogReader
from recorders.text.wording import names_text
from recorders.writing.writer import RESERVED


class SessionReader:
    """Reads the parts of a session as one log, with the interface of `LogReader`.

    Parameters
    ----------
    parts : Parts
        The logs, in order.

    Raises
    ------
    LogError
        As from `LogReader`, for any of the parts.
    """

    def __init__(self, parts: Parts) -> None:
        self.path = parts
        self.parts = [LogReader(path) for path in parts.paths]

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
        publish_times: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages, undecoded: see `LogReader.records`.

        Parts of our recorder follow one another, as all do in the order of the files. Those of others may overlap, and
        are merged by log time; no part is open before its first message is due.
        """
        wanted = None if topics is None else frozenset(topics)
        reads = [
            partial(
                part.records,
                topics=wanted,
                start_ns=start_ns,
                end_ns=end_ns,
                file_order=file_order,
                publish_times=publish_times,
            )
            for part in self.parts
        ]
        in_turn = file_order or self._recorded_here
        return chain.from_iterable(read() for read in reads) if in_turn else merged_by_time(reads)

    @cached_property
    def _recorded_here(self) -> bool:
        return all(part.manifest for part in self.parts)

    @property
    def protected(self) -> bool:
        """Whether CRCs cover every message and the summary of every part."""
        return all(part.protected for part in self.parts)

    @property
    def manifest(self) -> dict[str, Any]:
        """Manifest of the session: values of later parts replace earlier ones."""
        entries = {key: value for part in self.parts for key, value in part.manifest.items()}
        return {key: value for key, value in entries.items() if key not in (*RESERVED, PART)}

    @property
    def indexed(self) -> bool:
        """Whether every part states its channels and counts at its end."""
        return all(part.indexed for part in self.parts)

    @property
    def by_file(self) -> bool:
        """Whether its messages go by the order of the files, whatever their log times."""
        return self._recorded_here

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""
        found: dict[str, str] = {}
        for part in self.parts:
            for topic, kind in part.topics.items():
                found[topic] = found.get(topic) or kind
        return found

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel as it was declared in any of the parts, with its schema."""
        return tuple(dict.fromkeys(channel for part in self.parts for channel in part.channels))

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic."""
        return dict(sum((Counter(part.counts) for part in self.parts), Counter[str]()))

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments."""
        return tuple(dict.fromkeys(name for part in self.parts for name in part.attachments))

    def attachment(self, name: str) -> bytes:
        """Return an attachment, of several of one name the last; raises LogError if there is none."""
        for part in reversed(self.parts):
            if name in part.attachments:
                return part.attachment(name)
        raise LogError(f"{self.path}: no attachment {name!r}; there are: {names_text(self.attachments) or 'none'}")


# log time [ns] and part of the next message
_UnderWay: TypeAlias = tuple[int, int, RecordedMessage, Iterator[RecordedMessage]]


def merged_by_time(parts: Sequence[Callable[[], Iterator[RecordedMessage]]]) -> Iterator[RecordedMessage]:
    """Yield the messages of parts by log time, those of one time in the order of the parts."""
    firsts = ((part, next(read(), None)) for part, read in enumerate(parts))
    waiting = deque(sorted((first.log_time_ns, part) for part, first in firsts if first is not None))
    under_way: list[_UnderWay] = []  # a heap; no two of one part
    while waiting or under_way:
        while waiting and (not under_way or waiting[0] <= under_way[0][:2]):
            _, part = waiting.popleft()
            _advance(under_way, part, parts[part]())
        _, part, record, stream = heapq.heappop(under_way)
        yield record
        _advance(under_way, part, stream)


def _advance(under_way: list[_UnderWay], part: int, stream: Iterator[RecordedMessage]) -> None:
    record = next(stream, None)
    if record is not None:
        heapq.heappush(under_way, (record.log_time_ns, part, record, stream))
