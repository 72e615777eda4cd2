"""Channel tables that senders publish, so that recorders can declare the same channels.

A sender publishes a table on `NAMESPACE/@replay/SENDER/channels` before its first message, and answers queries there
for as long as its stream lasts, so that a recorder that comes late learns the types, too. What comes from the network
is bounded, and checked before it is believed.
"""

import base64
import json
import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Self, TypeAlias, TypeVar

import zenoh

from recorders.errors import WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.text.once import OnceWarner
from recorders.wire.callbacks import on_network_thread

logger = logging.getLogger(__name__)

TABLE_VERSION = 1
MAX_TABLE = 4 << 20
"""Most that a table may take [bytes]."""

_MAX_NAME = 1000  # characters
_ANSWER_S = 2.0
_MAX_LINE = 300  # characters
_MAX_SENDERS = 16  # whose tables are remembered

Schema: TypeAlias = tuple[str, str, bytes]
_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


def table_key(namespace: str, sender: str) -> str:
    """Return the key on which a sender, 32 hexadecimal digits, publishes its channels."""
    return f"{namespace}/@replay/{sender}/channels"


def to_json(channels: Iterable[DeclaredChannel]) -> bytes:
    """Return the table of channels as JSON; a schema that several of them share is in it once."""
    rows: list[dict[str, Any]] = []
    schemas: dict[Schema, int] = {}
    for channel in channels:
        place = None if channel.schema is None else schemas.setdefault(channel.schema, len(schemas))
        rows.append(
            {
                "topic": channel.topic,
                "encoding": channel.encoding,
                "metadata": dict(channel.metadata),
                "schema": place,
            }
        )
    texts = [
        {"name": name, "encoding": encoding, "data": base64.b64encode(data).decode()}
        for name, encoding, data in schemas
    ]
    return json.dumps({"version": TABLE_VERSION, "channels": rows, "schemas": texts}).encode()


def from_json(data: bytes) -> list[DeclaredChannel]:
    """Read a table of channels back.

    Raises
    ------
    WireError
        If it is not one, of another version, or larger than `MAX_TABLE`.
    """
    if len(data) > MAX_TABLE:
        raise WireError(f"channels: expected at most {MAX_TABLE} bytes, found {len(data)}")
    try:
        found = json.loads(data)
        if found["version"] != TABLE_VERSION:
            raise WireError(f"channels: expected version {TABLE_VERSION}, found {str(found['version'])[:40]!r}")
        schemas = [_schema(row) for row in _rows(found["schemas"])]
        return [_channel(row, schemas) for row in _rows(found["channels"])]
    except (ValueError, KeyError, TypeError, IndexError, RecursionError) as error:
        raise WireError(f"channels: expected topics, encodings and schemas, found {data[:80]!r}") from error


@contextmanager
def published_channels(
    session: zenoh.Session,
    namespace: str,
    sender: str,
    channels: Sequence[DeclaredChannel],
) -> Iterator[None]:
    """Publish the channels of a stream, and answer whoever asks for them, while the block runs.

    If they are too many, none travels, and that is reported.
    """
    table, key = to_json(channels), table_key(namespace, sender)
    if len(table) > MAX_TABLE:
        logger.warning(
            f"types and schemas take {len(table)} bytes, more than the {MAX_TABLE} that travel: a recorder learns none"
        )
    if not channels or len(table) > MAX_TABLE:
        yield
        return

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, table)

    with session.declare_queryable(key, answer):
        session.put(key, table, congestion_control=zenoh.CongestionControl.BLOCK)
        yield


class SenderChannels:
    """The channels of the known senders: as they were published, or else as a sender answers when asked once.

    A context manager: it subscribes for as long as the block runs. A table is taken in on the thread that reads it from
    the network, so that it is known before the messages that follow it are, whichever thread those wait for.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    namespace : str
        First part of every key.
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self._session = session
        self._namespace = namespace
        self._warnings = OnceWarner(logger, limit=_MAX_SENDERS, longest=_MAX_LINE)
        self._published: dict[str, bytes] = {}  # by key, not read yet
        self._tables: dict[bytes, dict[str, list[DeclaredChannel]]] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        key, remote = table_key(self._namespace, "*"), zenoh.Locality.REMOTE
        subscriber = on_network_thread(
            lambda call: self._session.declare_subscriber(key, call, allowed_origin=remote), self._on_table
        )
        self._stack.enter_context(subscriber)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def find(self, sender: bytes, topic: str, type_name: str) -> DeclaredChannel | None:
        """Return the channel of a message as its sender declared it; None if it declared none."""
        table = self._tables.get(sender)
        if table is None:
            table = self._ask(sender)
        channels = table.get(topic, [])
        of_type = [channel for channel in channels if channel.type == type_name]
        return of_type[0] if of_type else channels[0] if len(channels) == 1 else None

    def _ask(self, sender: bytes) -> dict[str, list[DeclaredChannel]]:
        table: dict[str, list[DeclaredChannel]] = {}
        try:
            for channel in self._answer(sender):
                table.setdefault(channel.topic, []).append(channel)
        except WireError as error:
            self._warnings.warn(str(error))
        _remember(self._tables, sender, table)
        return table

    def _on_table(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT and len(sample.payload) <= MAX_TABLE:
            _remember(self._published, str(sample.key_expr), sample.payload.to_bytes())

    def _answer(self, sender: bytes) -> list[DeclaredChannel]:
        key = table_key(self._namespace, sender.hex())
        if (published := self._published.pop(key, None)) is not None:
            return from_json(published)
        for reply in self._session.get(key, timeout=_ANSWER_S):
            if reply.ok is not None and len(reply.ok.payload) <= MAX_TABLE:
                return from_json(reply.ok.payload.to_bytes())
        return []


def _remember(table: dict[_Key, _Value], key: _Key, value: _Value) -> None:
    """Keep a value, and no more than so many: the oldest goes."""
    while len(table) >= _MAX_SENDERS:
        table.pop(next(iter(table)), None)
    table[key] = value


def _rows(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError("expected a list")
    return value


def _schema(row: Any) -> Schema:
    return _text(row["name"]), _text(row["encoding"]), base64.b64decode(row["data"], validate=True)


def _channel(row: Any, schemas: Sequence[Schema]) -> DeclaredChannel:
    place, metadata = row["schema"], row["metadata"]
    if not (isinstance(metadata, dict) and (place is None or (type(place) is int and place >= 0))):
        raise ValueError("a channel of another form")
    pairs = tuple((_text(name), _text(value, MAX_TABLE)) for name, value in metadata.items())
    schema = None if place is None else schemas[place]
    return DeclaredChannel(_text(row["topic"]), _text(row["encoding"]), pairs, schema)


def _text(value: Any, longest: int = _MAX_NAME) -> str:
    if not isinstance(value, str) or len(value) > longest:
        raise ValueError("a name of another form")
    value.encode()  # no half of a pair of surrogates, which no log can hold
    return value
