"""The MCAP writer: messages to a log that any ROS 2 tool opens, with a manifest of its origin."""

import os
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Self, TypeAlias

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.errors import LogError, MessageError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.mcap_format.manifest import (
    FORMAT_VERSION,
    METADATA_NAME,
    ContentHash,
    environment,
    stated_counts,
    to_metadata,
    topic_frame,
)
from recorders.messages.message_types import TypedMessage
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.text.wording import names_text
from recorders.writing.chunk_writer import ChunkWriter
from recorders.writing.log_file import LogFile

RESERVED = ("format_version", "complete", "messages", "counts", "content_sha256", "environment")

# topic, type, numbered by its producer, of another log
_Channel: TypeAlias = tuple[str, str, bool, DeclaredChannel | None]

# topic, type if given, numbered by its producer, opaque, of another log
_Asked: TypeAlias = tuple[str, str | None, bool, bool, DeclaredChannel | None]

MAX_CHANNELS = 2**16 - 1
"""As many as MCAP's numbers of channels distinguish."""

_SEQUENCE_BITS = 32
_TIME_BITS = 64
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class LogWriter:
    """Writes one log; a context manager, for one thread at a time.

    The file is `PATH.part` until the block ends without an exception; then it gets its name. It begins with its
    manifest, `complete` false, and ends with it once more, with `complete`, `messages`, `counts` by topic and
    `content_sha256`. After an exception it is finished too, as not complete, and stays readable as `PATH.part` (it is
    removed if it holds no message).

    A killed process loses no message that is older than 100 ms, and never more than 64; a power failure costs about a
    second. What is handed over because it has waited for long ends a chunk at a moment that depends on the clock. Two
    identical recordings give two identical files nevertheless: a log with such chunks is copied at its end into those
    that it would have had without a pause.

    Parameters
    ----------
    path : path
        Where the log goes, usually `NAME.mcap`.
    manifest : mapping
        What made the log (robot, motion, seeds, parameters): JSON values by name. The writer adds `format_version`
        and `environment`, and the entries of its end.
    attachments : mapping of bytes by name
        Files that belong to the log, such as the URDF and the robot's configuration.
    overwrite : bool
        Whether a log of this name may be replaced. A `.part` that nobody writes any more is set aside in any case.
    rechunk : bool
        Whether that copy is made. Where log times come from a clock on the wall no two recordings are identical anyway.

    Raises
    ------
    LogError
        From every method, if the file exists, cannot be written or is none, or the manifest is not JSON. What goes
        wrong meanwhile is raised by the next call, once.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        manifest: Mapping[str, Any],
        attachments: Mapping[str, bytes] = _NOTHING,
        overwrite: bool = False,
        rechunk: bool = True,
    ) -> None:
        self.path = Path(path)
        self._given = dict(manifest)
        self._manifest = _with_environment(manifest)
        self._content = ContentHash()
        self._topics: dict[int, str] = {}  # by the number of their channel
        self._frames: dict[int, bytes] = {}  # the same as they are hashed
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[_Channel, int] = {}
        self._asked: dict[_Asked, int] = {}
        self._numbered: defaultdict[str, int] = defaultdict(int)
        self._file = LogFile(self.path, end=self._end, on_chunk=self._add_content, overwrite=overwrite, rechunk=rechunk)
        self.part = self._file.part
        try:
            self._file.change(lambda: self._begin(attachments))
        except BaseException:
            self._file.abort()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()

    def write(
        self,
        topic: str,
        message: TypedMessage | bytes,
        *,
        log_time_ns: int,
        sequence: int | None = None,
        type_name: str | None = None,
        opaque: bool = False,
        declared: DeclaredChannel | None = None,
        publish_time_ns: int | None = None,
    ) -> None:
        """Write one message.

        Parameters
        ----------
        topic : str
            ROS topic name; those of `recorders.messages.topics` have a fixed type.
        message : Message or bytes
            A message, or CDR bytes that are written as they are.
        log_time_ns : int
            Time of recording [ns].
        sequence : int, optional
            The producer's number. Without one the messages of a topic are numbered from 0.
        type_name : str, optional
            ROS 2 type of bytes on a topic that is not in the table.
        opaque : bool
            The bytes are not a ROS 2 message: they go to a channel of their own, without a schema.
        declared : DeclaredChannel, optional
            The channel of bytes that come from another log: its encoding, schema and metadata are taken over, whatever
            they are.
        publish_time_ns : int, optional
            Its publisher's time [ns]; the log time if it is left out.

        Raises
        ------
        MessageError
            If the type is not the topic's or not known, a number is out of range, or it takes one channel too many.
        LogError
            If the file cannot be written.
        """
        data, kind = (message, type_name) if isinstance(message, bytes) else (encode(message), message.TYPE)
        number = self._numbered[topic] if sequence is None else sequence
        published_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        if number >> _SEQUENCE_BITS or log_time_ns >> _TIME_BITS or published_ns >> _TIME_BITS:  # large, or negative
            raise _out_of_range(topic, number, log_time_ns, published_ns)
        asked = (topic, kind, sequence is not None, opaque, declared)
        try:
            channel = self._asked[asked]
        except KeyError:
            channel = self._find_channel(asked)
        file = self._file
        if not file.sound:
            file.check()
        if file.chunks.gather((channel, number, log_time_ns, published_ns, data)):
            file.change(file.chunks.end_chunk)
        if sequence is None:
            self._numbered[topic] = number + 1

    def copy(self, record: RecordedMessage) -> None:
        """Write a record as it is: bytes, sequence and log time of its own; raises as `write` does."""
        self.write(
            record.topic,
            record.data,
            log_time_ns=record.log_time_ns,
            sequence=record.sequence,
            type_name=record.type,
        )

    def attach(self, name: str, data: bytes) -> None:
        """Add an attachment that became known after the beginning; raises LogError if that fails."""
        self._file.change(lambda: self._file.chunks.attach(name, data))

    def note(self, entries: Mapping[str, Any]) -> None:
        """Add to the manifest what became known after the beginning; raises LogError if it is not JSON."""
        given = {**self._given, **entries}
        self._manifest = _with_environment(given)
        self._given = given
        self._file.change(self._describe)

    def flush(self) -> None:
        """Hand everything written so far to the operating system; raises LogError if that fails."""
        self._file.change(self._file.chunks.flush)

    def check(self) -> None:
        """Raise LogError if nothing can be written any more, for whoever has nothing to write just now."""
        self._file.check()

    def close(self) -> None:
        """Finish the log and give it its name; raises LogError if that fails."""
        self._file.close()

    def abort(self) -> None:
        """Finish the log as incomplete, as well as the disk allows, and leave it as `PATH.part`; raises nothing."""
        self._file.abort()

    def _begin(self, attachments: Mapping[str, bytes]) -> None:
        self._describe()
        for name, data in attachments.items():
            self._file.chunks.attach(name, data)

    def _add_content(self, messages: MessageColumns) -> None:
        """Take the messages of a chunk into the hash."""
        self._content.add_all(self._frames, messages)

    def _describe(self) -> None:
        """Write the manifest as it is before the end: what comes later in the file replaces it."""
        self._file.chunks.add_metadata(METADATA_NAME, to_metadata({**self._manifest, "complete": False}))

    def _end(self, chunks: ChunkWriter, complete: bool) -> None:
        chunks.end_messages()
        counts: Counter[str] = Counter()
        for channel, count in chunks.counts.items():
            counts[self._topics[channel]] += count
        outcome = {
            "complete": complete,
            "messages": counts.total(),
            "counts": stated_counts(counts),
            "content_sha256": self._content.hexdigest(),
        }
        chunks.add_metadata(METADATA_NAME, to_metadata({**self._manifest, **outcome}))

    def _find_channel(self, asked: _Asked) -> int:
        """Return the number of the channel that a message asks for; raises as `write` does."""
        topic, kind, producer, opaque, declared = asked
        expected = type_of(topic)
        found = "" if opaque or declared is not None else kind or expected
        if found and expected and found != expected:
            raise MessageError(f"{topic}: expected {expected}, found {found}")
        channel = (topic, found, producer, declared)
        if channel not in self._channels:
            if len(self._channels) == MAX_CHANNELS:
                raise MessageError(f"{topic}: a log holds no more than {MAX_CHANNELS} channels")
            described = declared or (_opaque(topic) if opaque else _standard(topic, found))
            self._file.change(lambda: self._open_channel(channel, described))
        number = self._asked[asked] = self._channels[channel]
        return number

    def _open_channel(self, channel: _Channel, declared: DeclaredChannel) -> None:
        topic, _, producer, _ = channel
        schema = 0  # MCAP's number for no schema
        if declared.schema is not None:
            known = self._schemas.get(declared.schema)
            schema = known or self._file.chunks.register_schema(*declared.schema)
            self._schemas[declared.schema] = schema
        metadata = {**dict(declared.metadata), "sequence": "producer" if producer else "writer"}
        number = self._file.chunks.register_channel(topic, declared.encoding, schema, metadata)
        self._channels[channel], self._topics[number], self._frames[number] = number, topic, topic_frame(topic)


def _opaque(topic: str) -> DeclaredChannel:
    return DeclaredChannel(topic, "application/octet-stream")


def _standard(topic: str, type_name: str) -> DeclaredChannel:
    """Return the channel of messages of a standard ROS 2 type; raises MessageError if there is none of this name."""
    return DeclaredChannel(topic, "cdr", schema=(type_name, "ros2msg", schema_text(type_name).encode()))


def _with_environment(manifest: Mapping[str, Any]) -> dict[str, Any]:
    taken = [key for key in RESERVED if key in manifest]
    if taken:
        raise LogError(f"manifest: {names_text(taken)} is set by the writer; choose another name")
    complete = {**manifest, "format_version": FORMAT_VERSION, "environment": environment()}
    to_metadata(complete)  # refuse what is not JSON now, not after the recording
    return complete


def _out_of_range(topic: str, number: int, log_time_ns: int, published_ns: int) -> MessageError:
    return MessageError(
        f"{topic}: sequence {number}, log time {log_time_ns} ns or publish time {published_ns} ns is out of range"
    )
