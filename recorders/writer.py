"""The MCAP writer: messages to a log that any ROS 2 tool opens, with a manifest that says what made it."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, BinaryIO, Self

from mcap.writer import CompressionType, Writer

from recorders.cdr import encode
from recorders.errors import LogError, MessageError
from recorders.manifest import FORMAT_VERSION, METADATA_NAME, ContentHash, environment, to_metadata
from recorders.messages import Message
from recorders.records import Stamped
from recorders.ros import schema_text
from recorders.topics import type_of

FLUSH_EVERY = 64  # messages; a crash loses at most these, and flushing this often costs nothing within noise
RESERVED = ("format_version", "complete", "messages", "content_sha256", "environment")

_MAX_SEQUENCE = 2**32 - 1
_MAX_TIME_NS = 2**64 - 1
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class LogWriter:
    """Writes one log; a context manager.

    The file is `PATH.part` until the block ends without an exception; then it gets its manifest with `complete` true
    and its name. After an exception it is finished too, with `complete` false, and stays readable as `PATH.part`
    (it is removed if it holds no message). Two identical recordings give two identical files.

    Parameters
    ----------
    path : path
        Where the log goes, usually `NAME.mcap`.
    manifest : mapping
        What made the log (robot, motion, seeds, parameters): JSON values by name. The writer adds `format_version`,
        `complete`, `messages`, `content_sha256` and `environment`.
    attachments : mapping of bytes by name
        Files that belong to the log, such as the URDF and the robot's configuration.
    overwrite : bool
        Whether a log of this name, or the `.part` of one, may be replaced.

    Raises
    ------
    LogError
        From every method, if the file exists, cannot be written or is none, or the manifest is not JSON.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        manifest: Mapping[str, Any],
        attachments: Mapping[str, bytes] = _NOTHING,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        if not self.path.name:
            raise self._no_file()
        self.part = self.path.with_name(self.path.name + ".part")
        self._given = dict(manifest)
        self._manifest = _with_environment(manifest)
        self._content = ContentHash()
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str, bool], int] = {}
        self._numbered: Counter[str] = Counter()
        self._messages = 0
        self._refuse_existing(overwrite=overwrite)
        self._file = self._open()
        # Any: the library says that it is typed, and annotates but half of its methods
        self._mcap: Any = Writer(self._file, compression=CompressionType.LZ4, enable_data_crcs=True)
        try:
            with self._writing():
                self._begin(attachments)
        except LogError:
            with suppress(OSError):
                self.part.unlink()
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
        message: Message | bytes,
        *,
        log_time_ns: int,
        sequence: int | None = None,
        type_name: str | None = None,
        opaque: bool = False,
    ) -> None:
        """Write one message.

        Parameters
        ----------
        topic : str
            ROS topic name; those of `recorders.topics` have a fixed type.
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

        Raises
        ------
        MessageError
            If the type is not the topic's or not known, or a number is out of range.
        LogError
            If the file cannot be written.
        """
        if isinstance(message, bytes):
            data, found = message, "" if opaque else type_name or type_of(topic)
        else:
            data, found = encode(message), message.TYPE
        expected = type_of(topic)
        if expected and found != expected and not opaque:
            raise MessageError(f"{topic}: expected {expected}, found {found}")
        producer = sequence is not None
        channel = self._channels.get((topic, found, producer)) or self._open_channel(
            topic, found, producer=producer, opaque=opaque
        )
        self._add(channel, topic, self._numbered[topic] if sequence is None else sequence, log_time_ns, data)
        self._numbered[topic] += not producer

    def copy(self, record: Stamped) -> None:
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
        with self._writing():
            self._mcap.add_attachment(0, 0, name, _media_type(name), data)

    def note(self, entries: Mapping[str, Any]) -> None:
        """Add to the manifest what became known after the beginning; raises LogError if it is not JSON."""
        self._manifest = _with_environment({**self._given, **entries})
        self._given = {**self._given, **entries}

    def flush(self) -> None:
        """Hand everything written so far to the operating system; raises LogError if that fails."""
        with self._writing():
            self._mcap.flush()

    def close(self) -> None:
        """Finish the log and give it its name; raises LogError if that fails."""
        if self._file.closed:
            return
        with self._writing():
            self._finish(complete=True)
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self.part.replace(self.path)

    def abort(self) -> None:
        """Finish the log as incomplete, as well as the disk allows, and leave it as `PATH.part`; raises nothing."""
        if self._file.closed:
            return
        with suppress(LogError), self._writing():
            self._finish(complete=False)
            self._file.close()
        if not self._messages:
            with suppress(OSError):
                self.part.unlink()

    def _refuse_existing(self, *, overwrite: bool) -> None:
        try:
            found, is_file, unfinished = self.path.exists(), self.path.is_file(), self.part.exists()
        except OSError as error:
            raise self._cannot_write(error) from error
        if found and not is_file:
            raise self._no_file()
        if overwrite:
            return
        if found:
            raise LogError(f"{self.path} exists: choose another name, or allow it to be overwritten")
        if unfinished:
            raise LogError(f"{self.part} is left from an unfinished recording: move it away, or allow overwriting")

    def _open(self) -> BinaryIO:
        try:
            return self.part.open("wb")  # buffered: the library leaves a truncated file on an unbuffered one
        except (OSError, ValueError) as error:  # ValueError: a name that no system can have
            raise self._cannot_write(error) from error

    def _no_file(self) -> LogError:
        return LogError(f"cannot write {self.path}: expected the name of a file, found something else")

    def _cannot_write(self, error: OSError | ValueError) -> LogError:
        return LogError(f"cannot write {self.part}: {getattr(error, 'strerror', None) or error}")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        if self._file.closed:
            raise LogError(f"cannot write {self.part}: the log was closed, or an earlier write failed")
        try:
            yield
        except OSError as error:
            with suppress(OSError):
                self._file.close()  # a record is half written: nothing sound can follow it
            raise self._cannot_write(error) from error

    def _begin(self, attachments: Mapping[str, bytes]) -> None:
        self._mcap.start(profile="ros2", library="reenact")
        for name, data in attachments.items():
            self._mcap.add_attachment(0, 0, name, _media_type(name), data)  # no times: identical runs, identical files
        self._mcap.flush()

    def _open_channel(self, topic: str, type_name: str, *, producer: bool, opaque: bool) -> int:
        schema = 0 if opaque else self._schemas.get(type_name)  # 0: MCAP's number for no schema
        if schema is None:
            text = schema_text(type_name).encode()
            schema = self._schemas[type_name] = self._mcap.register_schema(type_name, "ros2msg", text)
        numbered_by = {"sequence": "producer" if producer else "writer"}
        encoding = "application/octet-stream" if opaque else "cdr"
        channel: int = self._mcap.register_channel(topic, encoding, schema, numbered_by)
        self._channels[topic, type_name, producer] = channel
        return channel

    def _add(self, channel: int, topic: str, sequence: int, log_time_ns: int, data: bytes) -> None:
        if not (0 <= sequence <= _MAX_SEQUENCE and 0 <= log_time_ns <= _MAX_TIME_NS):
            raise MessageError(f"{topic}: sequence {sequence} or log time {log_time_ns} ns is out of range")
        with self._writing():
            self._mcap.add_message(channel, log_time_ns, data, log_time_ns, sequence)
            self._content.add(topic, sequence, log_time_ns, data)
            self._messages += 1
            if self._messages % FLUSH_EVERY == 0:
                self._mcap.flush()

    def _finish(self, *, complete: bool) -> None:
        outcome = {"complete": complete, "messages": self._messages, "content_sha256": self._content.hexdigest()}
        self._mcap.flush()
        self._mcap.add_metadata(METADATA_NAME, to_metadata({**self._manifest, **outcome}))
        self._mcap.finish()


def _with_environment(manifest: Mapping[str, Any]) -> dict[str, Any]:
    taken = [key for key in RESERVED if key in manifest]
    if taken:
        raise LogError(f"manifest: {', '.join(taken)} is set by the writer; choose another name")
    complete = {**manifest, "format_version": FORMAT_VERSION, "environment": environment()}
    to_metadata(complete)  # refuse what is not JSON now, not after the recording
    return complete


def _media_type(name: str) -> str:
    kinds = {".urdf": "application/xml", ".toml": "application/toml", ".json": "application/json"}
    return kinds.get(Path(name).suffix, "application/octet-stream")
