"""Readers of containers other than MCAP: what all of them have in common."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import Log
from recorders.reading.raw_messages import FOREVER_NS


class ForeignReader(ABC):
    """Reader of a container that has channels and messages, and nothing else of ours.

    Parameters
    ----------
    path : Path
        The recording.
    """

    def __init__(self, path: Path) -> None:
        self.path: Log = path

    @property
    @abstractmethod
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, with its schema."""

    @property
    @abstractmethod
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""

    @abstractmethod
    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`."""

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    @property
    def protected(self) -> bool:
        """Whether CRCs cover every message: these containers have none."""
        return False

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest of a log of ours: none."""
        return {}

    @property
    def by_file(self) -> bool:
        """Whether its messages go by the order of the file: by their log times."""
        return False

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return {channel.topic: channel.type for channel in self.channels}

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments: none."""
        return ()

    def attachment(self, name: str) -> bytes:
        """Raise LogError: there is no attachment."""
        raise LogError(f"{self.path}: no attachment {name!r}; there are: none")


def all_counts(counts: Sequence[dict[str, int]]) -> dict[str, int]:
    """Return the numbers of messages by topic of several files."""
    return dict(sum((Counter(each) for each in counts), Counter[str]()))
