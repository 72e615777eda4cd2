"""By what the messages of a log are put in order: by their log times, or by their places in the file."""

import struct
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode

from recorders.errors import LogError
from recorders.mcap_format.chunk_contents import MESSAGE
from recorders.mcap_format.manifest import METADATA_NAME, from_metadata, is_of_our_writer
from recorders.mcap_format.records import MAGIC
from recorders.mcap_format.sections import Head, heads
from recorders.mcap_format.summary import Contents, read_metadata

_MESSAGE = int(Opcode.MESSAGE)  # a plain number is compared faster than a member of an enumeration
_DATA_END = int(Opcode.DATA_END)
_TIMES = struct.Struct("<QQ")  # first and last of a chunk [ns]
_NAMED_AS_OURS = struct.pack("<I", len(METADATA_NAME)) + METADATA_NAME.encode()


class LogOrder(NamedTuple):
    """The order of a log.

    Attributes
    ----------
    by_file : bool
        Whether the log is one of our writer's: it goes by the order of the file, whatever its times.
    risen : bool
        Whether its chunks, and the messages beside them, follow one another in time, by their heads.
    """

    by_file: bool
    risen: bool


def find_order(file: BinaryIO, size: int, index: Contents) -> LogOrder:
    """Find the order of a log, from a verified summary and the heads of the records that it does not cover.

    Parameters
    ----------
    file : file
        A log.
    size : int
        Its size [bytes].
    index : Contents
        Contents of a verified summary; empty if there is none.
    """
    if any(_is_ours(file, entry.offset) for entry in index.metadata if entry.name == METADATA_NAME):
        return LogOrder(by_file=True, risen=False)
    look = _Look(file)
    risen = index.chunks.in_order
    for gap in index.chunks.gaps(len(MAGIC), size):
        look.last_ns = gap.before_ns
        for head in heads(file, gap.start, gap.end):
            if head.opcode == _DATA_END or not (risen := risen and look.at(head)):
                break
        if look.ours:
            return LogOrder(by_file=True, risen=False)
        risen = risen and look.last_ns <= gap.behind_ns
        if not risen:
            break
    return LogOrder(by_file=False, risen=risen)


class _Look:
    """A look at the heads of some records, one after another."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.last_ns = 0
        self.ours = False

    def at(self, head: Head) -> bool:
        """Take in the next head and return whether it goes on in time; our manifest ends the look too."""
        if head.opcode == _MESSAGE and len(head.begins) >= MESSAGE.size:
            first_ns = last_ns = MESSAGE.unpack_from(head.begins)[2]
        elif head.opcode == Opcode.CHUNK and len(head.begins) >= _TIMES.size:
            first_ns, last_ns = _TIMES.unpack_from(head.begins)
            if not last_ns:
                return False  # a chunk of the time 0 alone states none
        elif head.opcode == Opcode.METADATA and head.begins.startswith(_NAMED_AS_OURS):
            self.ours = _is_ours(self._file, head.offset)
            return not self.ours
        else:
            return True
        before_ns, self.last_ns = self.last_ns, last_ns
        return bool(before_ns <= first_ns <= last_ns)


def _is_ours(file: BinaryIO, offset: int) -> bool:
    try:
        return is_of_our_writer(from_metadata(read_metadata(file, offset)))
    except LogError:
        return False
