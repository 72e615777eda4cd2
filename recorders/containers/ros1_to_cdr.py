"""Poses and joints of ROS 1 as CDR, byte by byte: the two types that fill a recording, faster than field by field.

Only what is exactly a message of the usual definition is taken; everything else is left to the general way.
"""

import struct
from collections.abc import Callable

from recorders.containers.definitions import channel_definitions, ros_name, standard_definitions
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import JointState, PoseStamped

_HEAD = struct.Struct("<4xIII")  # a number, which ROS 2 has not, the stamp in s and ns, the length of the frame
_COUNT = struct.Struct("<I")
_POSE = 56  # bytes
_FLOAT = 8  # bytes
_END_S = 2**31  # seconds that ROS 2 has no more
_SECOND = 10**9  # ns
_ENCAPSULATION = b"\0\1\0\0"


def transcoder(channel: DeclaredChannel) -> Callable[[bytes], bytes | None] | None:
    """Return what makes CDR of a channel's messages, or None of one that is not as usual; None for other channels."""
    name = ros_name(channel.type)
    if channel.encoding != "ros1" or name not in (JointState.TYPE, PoseStamped.TYPE):
        return None
    usual = standard_definitions(1)
    if any(usual.get(part, fields)[1] != fields[1] for part, fields in channel_definitions(channel).items()):
        return None
    return pose_to_cdr if name == PoseStamped.TYPE else JointsToCdr().cdr


def pose_to_cdr(data: bytes) -> bytes | None:
    """Return a PoseStamped of ROS 1 as CDR; None if it is not as usual."""
    end = _end_of_head(data)
    if end is None or len(data) - end != _POSE:
        return None
    text = data[12:end]
    head = data[4:12] + _with_end(text)
    return _ENCAPSULATION + head + bytes(-len(head) % _FLOAT) + data[end:]


class JointsToCdr:
    """Makes CDR of JointState; the names of the joints are written once, as long as they stay the same."""

    def __init__(self) -> None:
        self._read, self._written = b"", b""  # frame and names, as they are and as CDR

    def cdr(self, data: bytes) -> bytes | None:
        """Return a message as CDR; None if it is not as usual."""
        end = _end_of_head(data)
        if end is None:
            return None
        start = 12 + len(self._read)
        if not self._read or data[12:start] != self._read:
            found = _names(data, end)
            if found is None:
                return None
            start, self._written = found
            self._read = data[12:start]
        pieces, size = [_ENCAPSULATION, data[4:12], self._written], 8 + len(self._written)
        for _ in range(3):
            if start + 4 > len(data):
                return None
            (count,) = _COUNT.unpack_from(data, start)
            stop = start + 4 + count * _FLOAT
            gap = -size % 4
            size += gap + 4
            padding = -size % _FLOAT if count else 0
            pieces += bytes(gap), data[start : start + 4], bytes(padding), data[start + 4 : stop]
            size += padding + count * _FLOAT
            start = stop
        return b"".join(pieces) if start == len(data) else None


def _end_of_head(data: bytes) -> int | None:
    """Return where the header ends; None if there is none, or one that ROS 2 cannot have."""
    if len(data) < _HEAD.size:
        return None
    seconds, nanoseconds, length = _HEAD.unpack_from(data)
    end: int = _HEAD.size + length
    return end if seconds < _END_S and nanoseconds < _SECOND and end <= len(data) else None


def _names(data: bytes, end: int) -> tuple[int, bytes] | None:
    """Return where the names of joints end, and frame and names as CDR."""
    if end + 4 > len(data):
        return None
    written = bytearray(_with_end(data[12:end]))
    (count,) = _COUNT.unpack_from(data, end)
    written += bytes(-len(written) % 4) + _COUNT.pack(count)
    place = end + 4
    for _ in range(count):
        if place + 4 > len(data):
            return None
        (length,) = _COUNT.unpack_from(data, place)
        stop = place + 4 + length
        if stop > len(data):
            return None
        written += bytes(-len(written) % 4) + _with_end(data[place:stop])
        place = stop
    return place, bytes(written)


def _with_end(text: bytes) -> bytes:
    """Return a text of ROS 1, with its length before it, as CDR has it: a zero byte ends it, which counts."""
    return _COUNT.pack(_COUNT.unpack_from(text)[0] + 1) + text[4:] + b"\0"
