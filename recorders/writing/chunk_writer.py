"""Chunk boundaries depend on content only: equal recordings are byte-identical."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import BinaryIO

from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from recorders.mcap_format.attachments import AttachmentHead
from recorders.writing.chunk_encoder import Pending
from recorders.writing.chunk_index_file import ChunkIndexFile
from recorders.writing.mcap_writer import McapWriter

FLUSH_EVERY = 64  # messages; a crash loses at most these, and flushing this often costs nothing within noise


class ChunkWriter:
    """Writes MCAP, and ends a chunk after every 64th message and before whatever is no message.

    Every end of a chunk is handed to the operating system. One that comes early (see `flush`) is against the rule.

    Parameters
    ----------
    file : binary file
        Empty, and buffered.
    path : Path
        What the file is called: the index of its chunks is kept beside it until the end.
    on_chunk : callable, optional
        Given the messages of each chunk that is written.

    Attributes
    ----------
    messages : int
        Messages written so far.
    pending : int
        Those of them that the operating system does not have yet.
    regular : bool
        Whether every chunk so far ended by the rule.

    Raises
    ------
    OSError
        From every method but the two that register and `close`, if the file cannot be written.
    """

    def __init__(
        self, file: BinaryIO, path: Path, *, on_chunk: Callable[[Sequence[Pending]], None] = lambda messages: None
    ) -> None:
        self._index = ChunkIndexFile(path)
        self._mcap = McapWriter(file, index=self._index, on_chunk=on_chunk)
        self.messages = 0
        self.pending = 0
        self.regular = True

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema, just before the first channel that has it; returns its number."""
        return self._mcap.register_schema(name, encoding, data)

    def register_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Declare a channel, just before its first message; returns its number."""
        return self._mcap.register_channel(topic, encoding, schema, metadata)

    def add_message(self, channel: int, sequence: int, log_time_ns: int, data: bytes) -> None:
        """Write a message."""
        self._mcap.add_message(channel, sequence, log_time_ns, log_time_ns, data)
        self.messages += 1
        self.pending += 1
        if self.messages % FLUSH_EVERY == 0:
            self._end_chunk()

    @property
    def counts(self) -> Mapping[int, int]:
        """Messages by channel, of the chunks that are written."""
        return self._mcap.counts

    def flush_messages(self) -> None:
        """Write the messages so far, as whatever is no message does that follows them."""
        self._end_chunk()

    def add_attachment(self, name: str, data: bytes) -> None:
        """Write an attachment, without times: identical runs give identical files."""
        self._end_chunk()
        self._mcap.add_attachment(AttachmentHead(0, 0, name, media_type(name), 0, len(data)), [data])
        self._mcap.flush()

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._end_chunk()
        self._mcap.add_metadata(name, texts)
        self._mcap.flush()

    def flush(self) -> None:
        """Hand everything written so far to the operating system, which may end a chunk early."""
        self.regular = self.regular and not self.pending
        self._end_chunk()

    def finish(self) -> None:
        """Write the summary, as the last thing of all."""
        self._end_chunk()
        self._mcap.finish()

    def close(self) -> None:
        """Discard what is stored beside the file; raises nothing."""
        self._index.close()

    def _end_chunk(self) -> None:
        self._mcap.flush()
        self.pending = 0


def rechunk_log(source: BinaryIO, target: BinaryIO, path: Path) -> None:
    """Copy a finished log of a `ChunkWriter`: the same content in the same order, in chunks that end by the rule.

    Parameters
    ----------
    source, target : binary file
        The log, and an empty file.
    path : Path
        Where the target is to be.

    Raises
    ------
    OSError
        If the target cannot be written.
    ValueError
        If the source does not read back as it was written.
    """
    copy = ChunkWriter(target, path)
    with closing(copy):
        for record in _read_back(source):
            _copy(record, copy)
        copy.finish()


def _read_back(source: BinaryIO) -> Iterator[McapRecord]:
    """Yield the records of a log up to its summary; raises as `rechunk_log` does."""
    records = StreamReader(source, validate_crcs=True).records
    while True:
        try:
            record = next(records)
        except OSError:
            raise
        except Exception as error:  # of many kinds: the library checks little before it reads
            raise ValueError("what was written does not read back") from error
        if isinstance(record, DataEnd):
            return
        yield record


def _copy(record: McapRecord, copy: ChunkWriter) -> None:
    match record:
        case Schema():
            copy.register_schema(record.name, record.encoding, record.data)
        case Channel():
            copy.register_channel(record.topic, record.message_encoding, record.schema_id, record.metadata)
        case Message():
            copy.add_message(record.channel_id, record.sequence, record.log_time, record.data)
        case Attachment():
            copy.add_attachment(record.name, record.data)
        case Metadata():
            copy.add_metadata(record.name, record.metadata)


def media_type(name: str) -> str:
    """Return what an attachment of this name is, as MCAP states it."""
    kinds = {".urdf": "application/xml", ".toml": "application/toml", ".json": "application/json"}
    return kinds.get(Path(name).suffix, "application/octet-stream")
