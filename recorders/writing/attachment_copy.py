"""Attachments of one log written to another, piece by piece: an error names the one of the two files that failed."""

from collections.abc import Iterator

from recorders.errors import LogError
from recorders.mcap_format.attachments import attachment_data, attachment_head
from recorders.mcap_format.records import RawRecord
from recorders.writing.mcap_writer import McapWriter


def copy_attachment(record: RawRecord, log: McapWriter) -> OSError | None:
    """Copy an attachment.

    Parameters
    ----------
    record : RawRecord
        The attachment.
    log : McapWriter
        The log that it goes to.

    Returns
    -------
    OSError or None
        What the log that it goes to failed with: to be raised where the other one is not blamed for it.

    Raises
    ------
    LogError
        If the attachment is malformed or cannot be read.
    """
    try:
        log.add_attachment(attachment_head(record), _read(record))
    except OSError as error:
        return error
    return None


def _read(record: RawRecord) -> Iterator[memoryview]:
    try:
        yield from attachment_data(record)
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}") from error
