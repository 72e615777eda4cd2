"""Chunk boundaries depend on content only: equal recordings are byte-identical."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import BinaryIO

from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from recorders.mcap_format.attachments import AttachmentHead
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.writing.chunk_index_file import ChunkIndexFile
from recorders.writing.mcap_writer import McapWriter

FLUSH_EVERY = 64  # messages; a crash loses at most these, and flushing this often costs nothing within noise


class ChunkWriter(McapWriter):
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
    regular : bool
        Whether every chunk so far ended by the rule.

    Raises
    ------
    OSError
        From every method but the two that register and `close`, if the file cannot be written.
    """

    def __init__(
        self, file: BinaryIO, path: Path, *, on_chunk: Callable[[MessageColumns], None] = lambda messages: None
    ) -> None:
        self._chunk_index = ChunkIndexFile(path)
        super().__init__(file, chunk_messages=FLUSH_EVERY, index=self._chunk_index, on_chunk=on_chunk)
        self.regular = True
        self._over = False

    def attach(self, name: str, data: bytes) -> None:
        """Write an attachment, without times: identical runs give identical files."""
        head = AttachmentHead(
            log_time_ns=0,
            create_time_ns=0,
            name=name,
            media_type=media_type(name),
            start=0,  # counts for nothing
            size=len(data),
        )
        self.add_attachment(head, [data])
        self._file.flush()

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write a metadata record."""
        super().add_metadata(name, texts)
        self._file.flush()

    def flush(self) -> None:
        """Hand everything written so far to the operating system, which may end a chunk early."""
        early = self.end_chunk()
        self.regular = self.regular and not early

    def end_chunk(self) -> bool:
        """Write the messages so far, as whatever is no message does that follows them."""
        written = not self._over and super().end_chunk()
        self._file.flush()
        return written

    def end_messages(self) -> None:
        """Write the messages so far; what another thread adds meanwhile is not written any more."""
        self.end_chunk()
        self._over = True

    def close(self) -> None:
        """Discard what is stored beside the file; raises nothing."""
        self._chunk_index.close()


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
            copy.add_message((record.channel_id, record.sequence, record.log_time, record.publish_time, record.data))
        case Attachment():
            copy.attach(record.name, record.data)
        case Metadata():
            copy.add_metadata(record.name, record.metadata)


def media_type(name: str) -> str:
    """Return what an attachment of this name is, as MCAP states it."""
    kinds = {".urdf": "application/xml", ".toml": "application/toml", ".json": "application/json"}
    return kinds.get(Path(name).suffix, "application/octet-stream")
