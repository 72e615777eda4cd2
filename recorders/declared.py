"""The channels of a log as they were declared, whole: topic, encoding, metadata and schema."""

from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from recorders.mcap_records import Record, parse


@dataclass(frozen=True, slots=True)
class Declared:
    """A channel, with nothing left out, so that it can be declared again in another log.

    Attributes
    ----------
    topic : str
        Its topic.
    encoding : str
        How its messages are encoded; `cdr` in our logs.
    metadata : tuple of pairs of str
        What else its writer said of it.
    schema : tuple of str, str and bytes, optional
        Name, encoding and text of its schema; None for a channel that was declared without one.
    """

    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...] = ()
    schema: tuple[str, str, bytes] | None = None

    @property
    def type(self) -> str:
        """The name of the schema, an empty string for none."""
        return self.schema[0] if self.schema else ""


@dataclass
class Declarations:
    """The channels met so far, by their number in the file."""

    channels: dict[int, Declared] = field(default_factory=dict)
    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)

    def learn(self, record: Record) -> None:
        """Take in a schema or channel record, pass over any other; raises LogError if it is malformed.

        A channel whose schema was not met is passed over too: nobody can tell what its messages are.
        """
        if record.opcode == Opcode.SCHEMA:
            schema = parse(Schema, record)
            self.schemas[schema.id] = schema.name, schema.encoding, schema.data
        elif record.opcode == Opcode.CHANNEL:
            channel = parse(Channel, record)
            if channel.schema_id and channel.schema_id not in self.schemas:
                return
            found = Declared(
                channel.topic,
                channel.message_encoding,
                tuple(channel.metadata.items()),
                self.schemas.get(channel.schema_id),
            )
            if self.channels.get(channel.id) != found:  # others' writers declare a channel in every chunk
                self.channels[channel.id] = found

    def copy(self) -> "Declarations":
        """Return the same, to learn more by itself."""
        return Declarations(dict(self.channels), dict(self.schemas))

    def add(self, other: "Declarations") -> None:
        """Take in what another knows and this does not."""
        self.channels = {**other.channels, **self.channels}
        self.schemas = {**other.schemas, **self.schemas}
