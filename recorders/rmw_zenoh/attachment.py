"""The attachment of a message in rmw_zenoh: number, time and publisher."""

import struct
from collections.abc import Callable
from typing import NamedTuple

from recorders.errors import MessageError

_LAYOUT = struct.Struct("<qqB16s")  # sequence number, source time, length of the GID, GID
_NUMBERS = struct.Struct("<qq")  # its first two
_MAX_SHORT = 2**32 - 1


class Attachment(NamedTuple):
    """What a publisher attaches to a message.

    Attributes
    ----------
    sequence : int
        Number of the message, from 1 on; gap-free for each publisher.
    source_time_ns : int
        The publisher's time [ns].
    gid : bytes
        16 bytes that name the publisher.
    """

    sequence: int
    source_time_ns: int
    gid: bytes

    @property
    def short_sequence(self) -> int:
        """The number as a log has it, in 32 bits; it begins anew after those."""
        return self.sequence & _MAX_SHORT

    def pack(self) -> bytes:
        """Return the 33 bytes."""
        return _LAYOUT.pack(self.sequence, self.source_time_ns, len(self.gid), self.gid)


def attaching(gid: bytes) -> Callable[[int, int], bytes]:
    """Return what packs the attachments of a publisher: of a number and a time [ns], as `Attachment.pack` does."""
    named = Attachment(0, 0, gid).pack()[_NUMBERS.size :]
    pack = _NUMBERS.pack
    return lambda sequence, source_time_ns: pack(sequence, source_time_ns) + named


def unpack(data: bytes) -> tuple[Attachment, bytes]:
    """Read an attachment, and return it with the bytes that follow it.

    Raises
    ------
    MessageError
        If it is none.
    """
    if len(data) < _LAYOUT.size:
        raise MessageError(f"expected an attachment of {_LAYOUT.size} bytes, found {len(data)}")
    sequence, source_time_ns, length, gid = _LAYOUT.unpack_from(data)
    if length != len(gid) or sequence < 0 or source_time_ns < 0:
        raise MessageError(
            f"expected a publisher's name of {len(gid)} bytes, a number and a time, found {length}, {sequence} and "
            f"{source_time_ns} ns"
        )
    return Attachment(sequence, source_time_ns, gid), data[_LAYOUT.size :]
