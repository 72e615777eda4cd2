"""The sound parts of a log and the messages in them: what a survey found, and how to read it."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import SEEK_SET
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Metadata

from recorders.errors import LogError, unreadable
from recorders.mcap_format.attachments import check_attachment
from recorders.mcap_format.channels import ChannelRegistry, DeclaredChannel
from recorders.mcap_format.chunk_contents import MESSAGE, split
from recorders.mcap_format.crc_coverage import carries_crc
from recorders.mcap_format.errors import DamagedLog, Redeclared, TooLarge
from recorders.mcap_format.records import RawRecord, chunk_data, parse, read_record
from recorders.mcap_format.unread import Unread
from recorders.recovery.summary_section import VerifiedSummary


class Damage(NamedTuple):
    """A place where a log is not what its writer wrote: where [bytes], what was found, how much is skipped [bytes]."""

    offset: int
    reason: str
    skipped: int


class Span(NamedTuple):
    """A run of whole records without damage: where it begins and ends [bytes]."""

    start: int
    end: int


class Attached(NamedTuple):
    """An attachment: its name, where its record stands, and how long it is [bytes]."""

    name: str
    offset: int
    size: int


class Salvaged(NamedTuple):
    """A message as it stands in the log.

    Attributes
    ----------
    offset : int
        Where it stands, or the chunk that holds it [bytes].
    span : int
        In which of the spans of the survey that is.
    protected : bool
        Whether it stands in a chunk whose CRC holds.
    channel : DeclaredChannel or None
        Its channel; None if the declaration of that is lost.
    sequence, log_time_ns, publish_time_ns, data
        As they were recorded.
    rest : Unread, optional
        Of a large message the part that is not in `data`, to be read before the next message.
    """

    offset: int
    span: int
    protected: bool
    channel: DeclaredChannel | None
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    rest: Unread | None = None


@dataclass
class LogSurvey:
    """Survey of a log, damaged or not: its sound parts, damage, and verified summary.

    Attributes
    ----------
    path, size
        The file, and its size [bytes].
    profile, library : str or None
        The log's own manifest, if that can be believed.
    spans : list of Span
        Its sound parts, in order.
    damage : list of Damage
        What is between them, or wrong elsewhere, in order.
    finished : bool
        Whether the log has its end.
    doubt_from : int
        From here on nothing is believed that has no CRC of its own [bytes].
    chunks : Counter
        Number of chunks by compression.
    chunks_with_crc : int
        How many of them carry a CRC.
    data_crc : bool
        Whether there is a CRC over the data section and it holds.
    summary : VerifiedSummary or None
        The summary section, if its CRC holds.
    manifest : dict
        The last manifest whose checksum holds; empty if there is none.
    metadata : list of int
        Where metadata of other programs stand, in order [bytes]; several may have one name.
    attachments : list of Attached
        The attachments.
    metadata_count : int
        How many metadata records there are, ours among them.
    declarations : ChannelRegistry
        The channels that a CRC protects.
    met : ChannelRegistry
        The channels that the messages are on, as far as these were read.
    """

    path: Path
    size: int
    profile: str | None = None
    library: str | None = None
    spans: list[Span] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    finished: bool = False
    doubt_from: int = 0
    chunks: Counter[str] = field(default_factory=Counter)
    chunks_with_crc: int = 0
    data_crc: bool = False
    summary: VerifiedSummary | None = None
    manifest: dict[str, Any] = field(default_factory=dict)
    metadata: list[int] = field(default_factory=list)
    attachments: list[Attached] = field(default_factory=list)
    metadata_count: int = 0
    declarations: ChannelRegistry = field(default_factory=ChannelRegistry)
    met: ChannelRegistry = field(default_factory=ChannelRegistry)

    @property
    def stated_counts(self) -> Counter[str] | None:
        """Number of messages by topic that the summary states, once these were read; None if it states none."""
        return self.summary.counts(self.met.channels) if self.summary else None

    def messages(self, *, on_progress: Callable[[float], None] = lambda fraction: None) -> Iterator[Salvaged]:
        """Yield the messages that can be believed, in file order; raises LogError if the file has changed since.

        Parameters
        ----------
        on_progress : callable
            Called with the fraction of the file that was read.
        """
        declarations = self.met = self.declarations.copy()
        with opened(self.path) as file:
            for number, span in enumerate(self.spans):
                file.seek(span.start, SEEK_SET)
                while file.tell() < span.end:  # nothing here holds a record beside the next one
                    yield from self._messages(read_record(file, span.end), number, declarations)
                    on_progress(file.tell() / self.size)

    def metadata_at(self, offset: int) -> Metadata:
        """Return the metadata that stand at a place; raises LogError if the file has changed since the survey."""
        with opened(self.path) as file:
            file.seek(offset)
            found: Metadata = parse(Metadata, read_record(file, self.size))
            return found

    @contextmanager
    def attachment(self, attached: Attached) -> Iterator[RawRecord]:
        """Yield the record of an attachment; raises LogError if the file has changed since the survey."""
        with opened(self.path) as file:
            file.seek(attached.offset)
            record = read_record(file, self.size)
            check_attachment(record)
            yield record

    def _messages(self, record: RawRecord, span: int, declarations: ChannelRegistry) -> Iterator[Salvaged]:
        protected = carries_crc(record)
        if not protected and record.offset >= self.doubt_from:
            return
        if record.opcode == Opcode.MESSAGE:
            place = record.offset, span, protected
            yield _salvaged(record.body, 0, len(record.body), place, declarations)._replace(rest=record.rest)
        elif record.opcode == Opcode.CHUNK:
            data, place = chunk_data(record), (record.offset, span, protected)
            del record  # its body would take memory beside the messages
            for opcode, start, end in split(data, place[0]):
                if opcode == Opcode.MESSAGE:
                    yield _salvaged(data, start, end, place, declarations)
                else:
                    self._register(declarations, RawRecord(opcode, place[0], data[start:end]))
        else:
            self._register(declarations, record)

    def _register(self, declarations: ChannelRegistry, record: RawRecord) -> None:
        """Take in a declaration, or note where it is of another channel than before, or one too many."""
        try:
            declarations.register(record)
        except (TooLarge, Redeclared) as error:
            if all(damage.reason != error.reason for damage in self.damage):
                self.damage.append(Damage(record.offset, error.reason, 0))


def _salvaged(
    data: bytes, start: int, end: int, place: tuple[int, int, bool], declarations: ChannelRegistry
) -> Salvaged:
    channel, sequence, log_time_ns, publish_time_ns = MESSAGE.unpack_from(data, start)
    declared = declarations.channels.get(channel)
    return Salvaged(*place, declared, sequence, log_time_ns, publish_time_ns, data[start + MESSAGE.size : end])


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a log for reading; every error within is a LogError that names it."""
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
    except DamagedLog as error:
        raise error.located(path) from None
    except LogError as error:
        raise LogError(f"{path}: {error}") from None
