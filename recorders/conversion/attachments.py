"""What recordings in MCAP hold beside messages, copied: attachments, in pieces, and metadata."""

import hashlib
from collections.abc import Iterable

from recorders.containers.reader import Reader
from recorders.mcap_format.attachments import AttachmentHead, attachment_data, attachment_head
from recorders.mcap_format.manifest import METADATA_NAME
from recorders.reading.reader import LogReader
from recorders.writing.attachment_copy import copy_attachment
from recorders.writing.chunk_writer import media_type
from recorders.writing.mcap_writer import McapWriter


def copy_attachments(parts: Iterable[LogReader], log: McapWriter) -> None:
    """Copy the attachments of logs in order, those of one name and content once; raises OSError if that fails."""
    there: set[tuple[str, str]] = set()
    failure: OSError | None = None
    for part in parts:
        with part.attachment_records() as records:
            for record in records:
                head, digest = attachment_head(record), hashlib.sha256()
                for piece in attachment_data(record):
                    digest.update(piece)
                if (head.name, digest.hexdigest()) not in there:
                    there.add((head.name, digest.hexdigest()))
                    if failure := copy_attachment(record, log):
                        break
        if failure:
            raise failure


def add_attachments(readers: Iterable[Reader], log: McapWriter) -> None:
    """Write the attachments of readers of something else than MCAP."""
    for reader in readers:
        for name in reader.attachments:
            data = reader.attachment(name)
            log.add_attachment(AttachmentHead(0, 0, name, media_type(name), 0, len(data)), [data])


def copy_metadata(parts: Iterable[LogReader], log: McapWriter) -> None:
    """Copy the metadata of logs in order, each once; not the manifest, which the new log has of its own."""
    found = [(name, tuple(content.items())) for part in parts for name, content in part.metadata]
    for name, content in dict.fromkeys(found):
        if name != METADATA_NAME:
            log.add_metadata(name, dict(content))
