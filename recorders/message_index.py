"""The message indexes behind a chunk: the log time of each of its messages, and where in it the message stands."""

import struct
from collections.abc import Iterator
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of the entries
_BEFORE_ENTRIES = 6  # bytes of a body
_ENTRY = np.dtype([("log_time_ns", "<u8"), ("place", "<u8")])
_MOST = 2**26  # bytes of the entries of a channel: a chunk has no more messages

_Entries: TypeAlias = NDArray[Any]


def states_order(file: BinaryIO) -> bool:
    """Whether the message indexes at the file's place, which stays, say that the messages are in order of log time.

    Nothing but the order of what they list is looked at: what they leave out, or state wrongly, is for others to find.
    """
    place = file.tell()
    found = list(_entries(file))
    file.seek(place)
    if not found:
        return False
    entries = np.concatenate(found) if len(found) > 1 else found[0]
    if not _rises(entries["place"]):
        entries = entries[np.argsort(entries["place"])]
    return _rises(entries["log_time_ns"])


def _entries(file: BinaryIO) -> Iterator[_Entries]:
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        opcode, length, _, size = _HEAD.unpack(head)
        if opcode != Opcode.MESSAGE_INDEX or size % _ENTRY.itemsize or not size <= length - _BEFORE_ENTRIES < _MOST:
            return
        yield np.frombuffer(file.read(length - _BEFORE_ENTRIES), _ENTRY, size // _ENTRY.itemsize)


def _rises(column: _Entries) -> bool:
    return bool((column[1:] >= column[:-1]).all())
