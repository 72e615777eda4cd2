"""Logs with the same data in every variant that MCAP allows: what may be left out, repeated or padded, by flags.

The flags are those of MCAP's own conformance suite: `ch` chunks, `mx` message indexes, `chx` chunk indexes, `ax`
attachment indexes, `mdx` metadata indexes, `rch` and `rsh` channels and schemas repeated in the summary, `st`
statistics, `sum` summary offsets, `pad` bytes that nobody knows at the end of records.
"""

import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

from every_record import packed
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from recorders.mcap_format.records import MAGIC
from recorders.messages.record import RecordedMessage

FLAGS = ("ch", "mx", "chx", "ax", "mdx", "rch", "rsh", "st", "sum", "pad")
PADDING = b"\x01\xff\xff"
UNPADDED = {Opcode.MESSAGE}  # its data go on to its end
_HEAD = struct.Struct("<BQ")


class Data(NamedTuple):
    """What a log holds: its schemas, channels, messages, attachments and metadata, in the order of the file."""

    schemas: Sequence[Schema] = ()
    channels: Sequence[Channel] = ()
    messages: Sequence[Message] = ()
    attachments: Sequence[Attachment] = ()
    metadata: Sequence[Metadata] = ()

    @property
    def stamped(self) -> list[RecordedMessage]:
        """The messages as a reader must yield them."""
        names = {schema.id: schema.name for schema in self.schemas}
        channels = {channel.id: (channel.topic, names.get(channel.schema_id, "")) for channel in self.channels}
        return [RecordedMessage(*channels[m.channel_id], m.data, m.sequence, m.log_time) for m in self.messages]


def variants() -> Iterator[frozenset[str]]:
    """Yield every set of flags that makes sense: indexes of chunks only where there are chunks."""
    for count in range(len(FLAGS) + 1):
        for chosen in map(frozenset, combinations(FLAGS, count)):
            if "ch" in chosen or not chosen & {"mx", "chx"}:
                yield chosen


class Variant:
    """One log under construction."""

    def __init__(self, flags: Iterable[str]) -> None:
        self.flags = frozenset(flags)
        self.raw = bytearray(MAGIC)
        self.indexes: dict[Opcode, list[McapRecord]] = {}

    def write(self, path: Path, data: Data) -> None:
        """Write the log."""
        self._add(Header("", ""))
        declared = (*data.schemas, *data.channels)
        if "ch" in self.flags and data.messages:
            self._chunk(declared, data.messages)
        else:
            self._add(*declared, *data.messages)
        for attachment in data.attachments:
            self._attachment(attachment)
        for metadata in data.metadata:
            begin = self._add(metadata)
            self._index(MetadataIndex(begin, len(self.raw) - begin, metadata.name), "mdx")
        self._end(data)
        path.write_bytes(self.raw)

    def _bytes(self, *records: McapRecord) -> bytes:
        raw = bytearray()
        for record in records:
            one = packed(record)
            opcode, length = _HEAD.unpack_from(one)
            if "pad" in self.flags and opcode not in UNPADDED:
                one = _HEAD.pack(opcode, length + len(PADDING)) + one[_HEAD.size :] + PADDING
            raw += one
        return bytes(raw)

    def _add(self, *records: McapRecord) -> int:
        begin = len(self.raw)
        self.raw += self._bytes(*records)
        return begin

    def _index(self, record: McapRecord, flag: str) -> None:
        if flag in self.flags:
            self.indexes.setdefault(Opcode(packed(record)[0]), []).append(record)

    def _chunk(self, declared: Iterable[McapRecord], messages: Sequence[Message]) -> None:
        data = self._bytes(*declared)
        places: dict[int, list[tuple[int, int]]] = {}
        for message in messages:
            places.setdefault(message.channel_id, []).append((message.log_time, len(data)))
            data += packed(message)
        first, last = min(m.log_time for m in messages), max(m.log_time for m in messages)
        begin = self._add(Chunk("", data, last, first, zlib.crc32(data), len(data)))
        end = len(self.raw)
        offsets = {}
        if "mx" in self.flags:
            offsets = {channel: self._add(MessageIndex(channel, entries)) for channel, entries in places.items()}
        length = len(self.raw) - end
        self._index(ChunkIndex(end - begin, begin, "", len(data), last, length, offsets, first, len(data)), "chx")

    def _attachment(self, attachment: Attachment) -> None:
        begin = self._add(attachment)
        index = AttachmentIndex(
            begin,
            len(self.raw) - begin,
            attachment.create_time,
            attachment.log_time,
            len(attachment.data),
            attachment.name,
            attachment.media_type,
        )
        self._index(index, "ax")

    def _end(self, data: Data) -> None:
        self._add(DataEnd(zlib.crc32(self.raw)))
        start = len(self.raw)
        groups: dict[Opcode, Sequence[Any]] = {}
        if "rsh" in self.flags:
            groups[Opcode.SCHEMA] = data.schemas
        if "rch" in self.flags:
            groups[Opcode.CHANNEL] = data.channels
        if "st" in self.flags:
            groups[Opcode.STATISTICS] = [self._statistics(data)]
        offsets = []
        for opcode, records in {**groups, **self.indexes}.items():
            if records:
                group = self._add(*records)
                offsets.append(SummaryOffset(opcode, group, len(self.raw) - group))
        summary = start if len(self.raw) > start else 0
        offsets_start = self._add(*offsets) if offsets and "sum" in self.flags else 0
        head = self._bytes(Footer(summary, offsets_start, 0))[: _HEAD.size + 16]
        self._add(Footer(summary, offsets_start, zlib.crc32(head, zlib.crc32(self.raw[start:])) if summary else 0))
        self.raw += MAGIC

    def _statistics(self, data: Data) -> Statistics:
        counts: dict[int, int] = {}
        for message in data.messages:
            counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
        times = [message.log_time for message in data.messages] or [0]
        chunks = int("ch" in self.flags and bool(data.messages))
        sizes = (len(data.attachments), len(data.channels), counts, chunks, len(data.messages))
        return Statistics(*sizes, max(times), min(times), len(data.metadata), len(data.schemas))


def _bytes(numbers: list[str]) -> bytes:
    return bytes(map(int, numbers))


_MADE: dict[str, Callable[[dict[str, Any]], McapRecord]] = {  # in the order of the fields of `Data`
    "Schema": lambda f: Schema(int(f["id"]), _bytes(f["data"]), f["encoding"], f["name"]),
    "Channel": lambda f: Channel(int(f["id"]), f["topic"], f["message_encoding"], f["metadata"], int(f["schema_id"])),
    "Message": lambda f: Message(
        int(f["channel_id"]), int(f["log_time"]), _bytes(f["data"]), int(f["publish_time"]), int(f["sequence"])
    ),
    "Attachment": lambda f: Attachment(
        int(f["create_time"]), int(f["log_time"]), f["name"], f["media_type"], _bytes(f["data"])
    ),
    "Metadata": lambda f: Metadata(f["name"], f["metadata"]),
}


def described(path: Path) -> Data:
    """Return what a file of MCAP's conformance suite holds, as the JSON beside it says."""
    found: dict[str, list[Any]] = {kind: [] for kind in _MADE}
    for record in json.loads(path.read_text())["records"]:
        if record["type"] == "DataEnd":
            break  # the summary repeats what came before
        if record["type"] in found:
            found[record["type"]].append(_MADE[record["type"]](dict(record["fields"])))
    return Data(*found.values())
