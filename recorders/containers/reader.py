"""The interface of what reads a log, whatever container it is in, and a reader that goes by another one."""

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


class DelegatingReader:
    """Reader of what another one reads: a base for those that change some of it.

    Parameters
    ----------
    reader : Reader
        The other one.
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    @property
    def path(self) -> Log:
        """The recording."""
        return self._reader.path

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages in order of log time; see `recorders.reading.reader.LogReader.records`."""
        return self._reader.records(topics=topics, start_ns=start_ns, end_ns=end_ns, file_order=file_order)

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    @property
    def protected(self) -> bool:
        """Whether CRCs cover every message and the summary."""
        return self._reader.protected

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest given to the log's writer; empty for a log of another writer."""
        return self._reader.manifest

    @property
    def by_file(self) -> bool:
        """Whether its messages go by the order of the file, whatever their log times."""
        return self._reader.by_file

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""
        return self._reader.topics

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel as it was declared, with its schema."""
        return self._reader.channels

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic that has any."""
        return self._reader.counts

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments."""
        return self._reader.attachments

    def attachment(self, name: str) -> bytes:
        """Return an attachment, of several of one name the last; raises LogError if there is none."""
        return self._reader.attachment(name)


Opened: TypeAlias = Log | Reader
"""A recording by its path or paths, or what reads one."""
