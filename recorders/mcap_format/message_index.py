"""The message indexes behind a chunk: the log time of each of its messages, and where in it the message stands."""

import struct
from collections.abc import Iterator
from io import SEEK_CUR
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of the entries
_BEFORE_ENTRIES = 6  # bytes of a body
_ENTRY = np.dtype([("log_time_ns", "<u8"), ("position", "<u8")])

_Entries: TypeAlias = NDArray[Any]


def states_order(file: BinaryIO, most: int) -> bool:
    """Whether the message indexes at the file's position, which stays, state that messages are in order of time.

    Nothing but the order of what they list is looked at: what they leave out, or state wrongly, is for others to find.

    Parameters
    ----------
    file : file
        A log, its position behind a chunk.
    most : int
        How many messages the chunk can have: indexes of more are not read.
    """
    position = file.tell()
    found = list(_entries(file, most))
    file.seek(position)
    if not found:
        return False
    entries = np.concatenate(found) if len(found) > 1 else found[0]
    if not _rises(entries["position"]):
        entries = entries[np.argsort(entries["position"])]
    return _rises(entries["log_time_ns"])


def _entries(file: BinaryIO, most: int) -> Iterator[_Entries]:
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        opcode, length, _, size = _HEAD.unpack(head)
        most -= size // _ENTRY.itemsize
        if opcode != Opcode.MESSAGE_INDEX or size % _ENTRY.itemsize or size > length - _BEFORE_ENTRIES or most < 0:
            return
        entries = file.read(size)
        if len(entries) < size:
            return
        yield np.frombuffer(entries, _ENTRY)
        file.seek(length - _BEFORE_ENTRIES - size, SEEK_CUR)


def _rises(column: _Entries) -> bool:
    return bool((column[1:] >= column[:-1]).all())
