"""The interface of what reads a log, whatever container it is in."""

from collections.abc import Iterable, Iterator
from typing import Any, Protocol, TypeAlias

from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import Log
from recorders.reading.raw_messages import FOREVER_NS


class Reader(Protocol):
    """Reader of one recording, which opens its files for each use."""

    @property
    def path(self) -> Log:
        """The recording."""

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages in order of log time; see `recorders.reading.reader.LogReader.records`."""

    def __iter__(self) -> Iterator[RecordedMessage]: ...

    @property
    def protected(self) -> bool:
        """Whether CRCs cover every message and the summary."""

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest given to the log's writer; empty for a log of another writer."""

    @property
    def by_file(self) -> bool:
        """Whether its messages go by the order of the file, whatever their log times."""

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel as it was declared, with its schema."""

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments."""

    def attachment(self, name: str) -> bytes:
        """Return an attachment, of several of one name the last; raises LogError if there is none."""


Opened: TypeAlias = Log | Reader
"""A recording by its path or paths, or what reads one."""
