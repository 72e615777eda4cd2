"""A walk through the data section of a log, record by record, that goes on behind damage."""

import zlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from recorders.errors import LogError
from recorders.mcap_format.attachments import attachment_head, check_attachment
from recorders.mcap_format.channels import ChannelRegistry
from recorders.mcap_format.chunk_contents import MESSAGE, checked, declarations
from recorders.mcap_format.crc_coverage import carries_crc
from recorders.mcap_format.errors import DamagedLog, Redeclared, TooLarge, damaged
from recorders.mcap_format.lengths import Expansion
from recorders.mcap_format.manifest import METADATA_NAME, from_metadata, to_metadata
from recorders.mcap_format.records import (
    CRC,
    FIRST_RESERVED,
    HEAD,
    INDEX,
    MAGIC,
    RawRecord,
    chunk_head,
    claimed_size,
    crc_of,
    parse,
    parse_counted,
    read_record,
)
from recorders.recovery.resync import find_proven, proves_itself
from recorders.recovery.salvage import Attached, Damage, Span
from recorders.recovery.summary_section import VerifiedSummary

NOT_WHOLE = "a record is not whole"

_GIVEN_UP = "so much is damaged that the search for sound parts was given up"
_PATIENCE = 20  # how often the whole file may be read in search of sound parts: a hostile one has many false heads
_FREE = 2**26  # bytes that may be read and decompressed in vain whatever the size
_MOST_UNKNOWN = 100
_MORE_UNKNOWN = "records of unknown kinds, here and further on"
_LONGEST_REASON = 200  # characters: some libraries quote all that they were given
_PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
}

_SUMMARY = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
        Opcode.FOOTER,
    }
)


class ResilientScan:
    """A scan of a log that goes on behind damage, and what it has met.

    Parameters
    ----------
    file : file
        A log.
    end : int
        Where to stop [bytes].
    summary : VerifiedSummary, optional
        Offset at which its summary states that records begin.
    on_progress : callable
        Called with the place reached [bytes].

    Attributes
    ----------
    offset : int
        The place reached [bytes].
    spans, damage : list
        Runs of sound records, and what is between them.
    crc : int or None
        CRC of everything up to the end of the data section, None if something is damaged.
    data_end : RawRecord or None
        The record that ends the data section.
    header : Header or None
        The record that begins the log.
    chunks, chunks_with_crc : Counter, int
        Chunks by compression, and how many carry a CRC.
    first_protected : int or None
        Where the first of those stands.
    declarations : ChannelRegistry
        The channels declared in them.
    unprotected : list of Span
        Messages, and chunks of them, that carry no CRC.
    attachments, bare : list of Attached
        Attachments with and without a CRC.
    manifest : dict
        The last manifest whose checksum holds.
    metadata_count : int
        Metadata records, ours among them.
    metadata : list of int
        Where metadata of other programs stand [bytes].
    unknown : list of Damage
        Records of unknown kinds, other programs' own or MCAP's of later, which damage may have made of ours.
    """

    def __init__(
        self, file: BinaryIO, end: int, summary: VerifiedSummary | None, on_progress: Callable[[int], None]
    ) -> None:
        self._file = file
        self._end = end
        self._summary = summary
        self._on_progress = on_progress
        self._budget = _PATIENCE * end + _FREE
        self._expansion = Expansion(end)
        self.offset = self._start = len(MAGIC)
        self.spans: list[Span] = []
        self.damage: list[Damage] = []
        self.crc: int | None = zlib.crc32(MAGIC)
        self.data_end: RawRecord | None = None
        self.header: Header | None = None
        self.chunks: Counter[str] = Counter()
        self.chunks_with_crc = 0
        self.first_protected: int | None = None
        self.declarations = ChannelRegistry()
        self.unprotected: list[Span] = []
        self.attachments: list[Attached] = []
        self.bare: list[Attached] = []
        self.manifest: dict[str, Any] = {}
        self.metadata_count = 0
        self.metadata: list[int] = []
        self.unknown: list[Damage] = []

    def run(self) -> None:
        """Walk to the end of the data section, or as far as there is anything whole."""
        while self.data_end is None and self.offset < self._end:
            self._take_next()
        self._close_span()

    def _take_next(self) -> None:
        try:
            record = self._read(self.offset)
            if self._swallows(record):
                raise damaged(record.offset, "a record is not as long as it states")
            self._take(record)
        except TooLarge as error:
            self._pass_over(error)
        except LogError as error:
            self._resume(error)
        else:
            self._step(record)

    def _read(self, offset: int) -> RawRecord:
        if self._budget < 0:
            raise damaged(offset, _GIVEN_UP)
        self._file.seek(offset)
        try:
            record = read_record(self._file, self._end)
        except DamagedLog as error:
            raise damaged(offset, error.reason or NOT_WHOLE) from None
        self._budget -= HEAD.size + record.size
        return record

    def _candidate(self, offset: int) -> RawRecord:
        """Read a record that may be none; a chunk only if what it claims to hold may still be decompressed in vain."""
        record = self._read(offset)
        if record.opcode == Opcode.CHUNK:
            size = claimed_size(record)
            if size > self._budget:
                raise damaged(offset, _GIVEN_UP)
            self._budget -= size
        return record

    def _swallows(self, record: RawRecord) -> bool:
        """Whether what follows the fields of a record is no more of it, but other records: its length is wrong."""
        try:
            rest = record.offset + HEAD.size + known_size(record)
        except LogError:
            return False
        return rest < record.end and find_proven(self._file, rest, record.end, self._candidate) is not None

    def _step(self, record: RawRecord) -> None:
        if self.crc is not None and record.opcode != Opcode.DATA_END:
            self.crc = crc_of(record, self.crc)
        self.offset = record.end
        self._on_progress(self.offset)

    def _take(self, record: RawRecord) -> None:
        """Check a record and remember what is in it; raises LogError if it is damaged or out of place."""
        if record.opcode in _PARSED:
            self._take_parsed(record)
        elif record.opcode == Opcode.CHUNK:
            self._take_chunk(record)
        elif record.opcode == Opcode.ATTACHMENT:
            into = self.attachments if check_attachment(record) else self.bare
            head = attachment_head(record)
            into.append(Attached(head.name, record.offset, head.size))
        elif record.opcode == Opcode.MESSAGE and len(record.body) >= MESSAGE.size:
            self._take_unprotected(record)
        elif self._is_data_end(record):
            self.data_end = record
        elif record.opcode >= FIRST_RESERVED:
            unknown = f"a record of unknown kind {record.opcode}"
            self._note_unknown(Damage(record.offset, unknown, record.size))
        elif not _is_index(record):
            raise damaged(record.offset, f"a record of kind {record.opcode} is malformed or out of place")

    def _note_unknown(self, found: Damage) -> None:
        if len(self.unknown) < _MOST_UNKNOWN:
            self.unknown.append(found)
        else:
            last = self.unknown[-1]
            self.unknown[-1] = last._replace(reason=_MORE_UNKNOWN, skipped=last.skipped + found.skipped)

    def _take_parsed(self, record: RawRecord) -> None:
        parsed = parse(_PARSED[record.opcode], record)
        self.metadata_count += record.opcode == Opcode.METADATA
        if record.opcode == Opcode.METADATA and parsed.name == METADATA_NAME:
            manifest = from_metadata(parsed.metadata)
            to_metadata(manifest)  # refuse what Python reads as JSON and nobody else does, such as NaN
            self.manifest = manifest
        elif record.opcode == Opcode.METADATA:
            self.metadata.append(record.offset)
        elif record.opcode == Opcode.HEADER and record.offset == len(MAGIC):
            self.header = parsed
        elif record.opcode == Opcode.HEADER:
            raise damaged(record.offset, "a header in the middle of the log")

    def _take_chunk(self, record: RawRecord) -> None:
        size = claimed_size(record)
        self._expansion.take(record.offset, chunk_head(record).size)
        self._budget -= size
        data = checked(record)
        self._budget += size  # not in vain
        if not carries_crc(record):
            self._take_unprotected(record)
        else:
            for each in declarations(data, record.offset):
                with suppress(Redeclared):  # noted where the messages are read
                    self.declarations.register(each)
            self.chunks_with_crc += 1
            self.first_protected = record.offset if self.first_protected is None else self.first_protected
        self.chunks[chunk_head(record).compression] += 1

    def _pass_over(self, error: TooLarge) -> None:
        """Leave out the record at this place, which is too large, and go on behind it."""
        self._close_span()
        record = self._read(self.offset)
        self._step(record)
        self._start = self.offset
        self.damage.append(Damage(record.offset, error.reason, record.end - record.offset))

    def _take_unprotected(self, record: RawRecord) -> None:
        if self.unprotected and self.unprotected[-1].end == record.offset:
            self.unprotected[-1] = Span(self.unprotected[-1].start, record.end)
        else:
            self.unprotected.append(Span(record.offset, record.end))

    def _resume(self, error: LogError) -> None:
        """Note damage at this place and go to the next whole record, or to the end if there is none."""
        at = self.offset
        self._close_span()
        self.crc = None
        found = self._next_whole()
        self.offset = self._start = self._end if found is None else found
        self.damage.append(Damage(at, _reason(error), self.offset - at))

    def _next_whole(self) -> int | None:
        if self._summary and self._summary.indexed:
            place = bisect_right(self._summary.offsets, self.offset)
            return self._summary.offsets[place] if place < len(self._summary.offsets) else None
        claimed = self._claimed_end()
        return find_proven(self._file, self.offset + 1, self._end, self._candidate) if claimed is None else claimed

    def _claimed_end(self) -> int | None:
        """Return the end that the damaged record at this offset states, if another record visibly begins there."""
        try:
            record = self._read(self.offset)
            if self._swallows(record):
                return None
            end = record.end
            following = self._candidate(end)
        except LogError:
            return None
        index = _is_index(following) and len(following.body) > INDEX.size
        return end if index or self._is_data_end(following) or proves_itself(following) else None

    def _is_data_end(self, record: RawRecord) -> bool:
        """Whether a record ends the data section; one that is longer than usual only if the summary follows it."""
        if record.opcode != Opcode.DATA_END or len(record.body) <= CRC.size or record.end == self._end:
            return record.opcode == Opcode.DATA_END and len(record.body) >= CRC.size
        try:
            return self._read(record.end).opcode in _SUMMARY
        except LogError:
            return False

    def _close_span(self) -> None:
        if self.offset > self._start:
            self.spans.append(Span(self._start, self.offset))


def known_size(record: RawRecord) -> int:
    """Return how long the fields of a record's body are that are known [bytes]; raises LogError if it is malformed."""
    if record.opcode in _PARSED:
        return parse_counted(_PARSED[record.opcode], record)[1]
    if record.opcode == Opcode.CHUNK:
        return chunk_head(record).end
    if record.opcode == Opcode.ATTACHMENT:
        return attachment_head(record).end + CRC.size
    if record.opcode == Opcode.DATA_END:
        return CRC.size
    return INDEX.size + int(INDEX.unpack_from(record.body)[1]) if _is_index(record) else record.size


def _reason(error: LogError) -> str:
    reason = error.reason if isinstance(error, DamagedLog) else str(error)
    return reason[:_LONGEST_REASON]


def _is_index(record: RawRecord) -> bool:
    """Whether this is the index of a chunk, as far as one can see."""
    if record.opcode != Opcode.MESSAGE_INDEX or len(record.body) < INDEX.size:
        return False
    size: int = INDEX.unpack_from(record.body)[1]
    return size % 16 == 0 and record.size >= INDEX.size + size
