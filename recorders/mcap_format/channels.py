"""The channels of a log as they were declared, whole: topic, encoding, metadata and schema."""

from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from recorders.mcap_format.errors import Redeclared, TooLarge
from recorders.mcap_format.lengths import MAX_CHANNEL, MAX_DECLARED
from recorders.mcap_format.records import RawRecord, parse
from recorders.text.wording import names_text

_SHOWN = 300  # characters of a line


@dataclass(frozen=True, slots=True)
class DeclaredChannel:
    """A channel, with nothing left out, so that it can be declared again in another log.

    Attributes
    ----------
    topic : str
        Its topic.
    encoding : str
        How its messages are encoded; `cdr` in our logs.
    metadata : tuple of pairs of str
        Other metadata that its writer gave.
    schema : tuple of str, str and bytes, optional
        Name, encoding and text of its schema; None for a channel that was declared without one.
    """

    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...] = ()
    schema: tuple[str, str, bytes] | None = None

    def __str__(self) -> str:
        return names_text([self.topic if self.schema is None else f"{self.topic} ({self.type})"], limit=_SHOWN)

    @property
    def type(self) -> str:
        """The name of the schema, an empty string for none."""
        return self.schema[0] if self.schema else ""


@dataclass
class ChannelRegistry:
    """The channels met so far, by their number in the file."""

    channels: dict[int, DeclaredChannel] = field(default_factory=dict)
    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    _size: int = 0  # bytes of all of them

    def register(self, record: RawRecord) -> Schema | Channel | None:
        """Take in a schema or channel record and return it parsed, pass over any other.

        A channel whose schema was not met is passed over too: the type of its messages is unknown.

        Raises
        ------
        TooLarge
            If these and all before are more than are held.
        Redeclared
            If the channel was of another topic or type until now; from here on it is of this one.
        LogError
            If it is malformed.
        """
        if record.opcode == Opcode.SCHEMA:
            schema: Schema = parse(Schema, record)
            stated = schema.name, schema.encoding, schema.data
            if self.schemas.get(schema.id) != stated:
                self._take(record)
                self.schemas[schema.id] = stated
            return schema
        if record.opcode == Opcode.CHANNEL:
            if len(record.body) > MAX_CHANNEL:
                raise TooLarge(record.offset, f"a channel of {len(record.body)} bytes, and {MAX_CHANNEL} is the most")
            channel: Channel = parse(Channel, record)
            self._register_channel(channel, record)
            return channel
        return None

    def _register_channel(self, channel: Channel, record: RawRecord) -> None:
        if channel.schema_id and channel.schema_id not in self.schemas:
            return
        found = DeclaredChannel(
            channel.topic,
            channel.message_encoding,
            tuple(channel.metadata.items()),
            self.schemas.get(channel.schema_id),
        )
        known = self.channels.get(channel.id)
        if known == found:  # others' writers declare a channel in every chunk
            return
        self._take(record)
        self.channels[channel.id] = found
        if known is not None and (known.topic, known.type) != (found.topic, found.type):
            raise Redeclared(record.offset, f"channel {channel.id} is declared as {found}, elsewhere as {known}")

    def copy(self) -> "ChannelRegistry":
        """Return the same, to learn more by itself."""
        return ChannelRegistry(dict(self.channels), dict(self.schemas), self._size)

    def _take(self, record: RawRecord) -> None:
        size = self._size + len(record.body)
        if size > MAX_DECLARED:
            raise TooLarge(
                record.offset, f"more than {MAX_DECLARED} bytes of schemas and channels, the most that is held"
            )
        self._size = size

    def add(self, other: "ChannelRegistry") -> None:
        """Take in what another knows and this does not."""
        self.channels = {**other.channels, **self.channels}
        self.schemas = {**other.schemas, **self.schemas}
        self._size = max(self._size, other._size)  # most know the same
