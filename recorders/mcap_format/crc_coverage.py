"""Coverage by CRCs: of a record by its own, of a log by some or other, so that no changed bit goes unnoticed."""

from io import SEEK_END
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import DataEnd

from recorders.mcap_format.attachments import attachment_has_crc
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.records import MAGIC, RawRecord, chunk_head, parse, read_record
from recorders.mcap_format.sections import read_data_end, read_footer
from recorders.mcap_format.summary import read_contents

_BESIDE_CHUNKS = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE})


def carries_crc(record: RawRecord) -> bool:
    """Whether a record has a CRC of its own: 0 means none. Raises DamagedLog if it is malformed."""
    if record.opcode == Opcode.CHUNK:
        return chunk_head(record).crc != 0
    return record.opcode == Opcode.ATTACHMENT and attachment_has_crc(record)


def is_protected(file: BinaryIO) -> bool:
    """Return whether CRCs cover every message, and the summary if there is one.

    Either one covers the whole data section, or each chunk has its own, nothing that a message needs stands beside the
    chunks, and a summary states where they are. Of a file that is cut off, what there is of it counts.

    Raises
    ------
    DamagedLog
        If something in it is damaged.
    """
    try:
        footer, end = read_footer(file), parse(DataEnd, read_data_end(file))
    except DamagedLog as error:
        if error.reason:
            raise
        return _in_chunks(file)
    if footer.summary_start and not footer.summary_crc:
        return False
    contents = None if end.data_section_crc else read_contents(file)
    return bool(end.data_section_crc) or (contents is not None and contents.crc_verified and _in_chunks(file))


def _in_chunks(file: BinaryIO) -> bool:
    """Return whether all that is there of the data section stands in chunks with CRCs."""
    size = file.seek(0, SEEK_END)
    file.seek(len(MAGIC))
    while True:
        try:
            record = read_record(file, size)
        except DamagedLog:
            return True
        if record.opcode == Opcode.DATA_END:
            return True
        if record.opcode in _BESIDE_CHUNKS or (record.opcode == Opcode.CHUNK and not carries_crc(record)):
            return False
