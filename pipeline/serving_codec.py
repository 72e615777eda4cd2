"""The two messages that a served controller cannot do without, read and written with as little ado as can be.

Both classes take the bytes that are constant from the codec itself, and leave to it whatever is unusual.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from recorders.cdr import decode_as, encode
from recorders.messages import JointState, PoseStamped

Floats = NDArray[np.float64]
Position = tuple[float, ...]
"""Of one hand [m], length 3."""

_STAMP = struct.Struct("<iI")  # s and ns, behind the four bytes of the encapsulation
_STAMP_AT = 4
_SECOND = 10**9


class CommandEncoder:
    """Writes the commands of one robot: they differ in stamp and positions alone, so all other bytes are kept.

    Parameters
    ----------
    joints : tuple of str
        Joint names, in the order of the positions.

    Attributes
    ----------
    positions : ndarray, shape (joints,)
        Positions of the next command [rad, m], to be written to: they are part of its bytes.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        payload = encode(JointState(0, joints, np.zeros(len(joints))))
        first = len(payload) - 8 - 8 * len(joints)  # behind them the lengths of velocities and efforts: there are none
        padding = -first % 8  # the positions begin at a multiple of eight bytes
        memory = bytearray(padding) + payload
        self._payload = memoryview(memory)[padding:]
        self.positions: Floats = np.frombuffer(memory, np.float64, len(joints), padding + first)

    def encode(self, stamp_ns: int) -> bytes:
        """Return a JointState as CDR, the bytes that `recorders.cdr.encode` gives, with a stamp [ns]."""
        _STAMP.pack_into(self._payload, _STAMP_AT, *divmod(stamp_ns, _SECOND))
        return bytes(self._payload)


class PoseReader:
    """Reads stamp and position out of poses in the world frame without making a message; others it decodes."""

    def __init__(self) -> None:
        payload = encode(PoseStamped(0, np.zeros(3)))
        self._size = len(payload)
        frame = self._size - 12 - 7 * 8  # the bytes between the stamp and the seven numbers
        self._layout = struct.Struct(f"<4siI{frame}s3d")
        self._encapsulation, _, _, self._frame, *_ = self._layout.unpack_from(payload)
        self._headed = struct.Struct(f"<{12 + frame}s3d")

    def read(self, data: bytes) -> tuple[int, Position]:
        """Return stamp [ns] and position [m] of a PoseStamped; raises MessageError if it is none."""
        if len(data) == self._size:
            encapsulation, seconds, nanoseconds, frame, x, y, z = self._layout.unpack_from(data)
            usual = encapsulation == self._encapsulation and frame == self._frame
            if usual and seconds >= 0 and nanoseconds < _SECOND:
                return seconds * _SECOND + nanoseconds, (x, y, z)
        pose = decode_as(PoseStamped, data)
        return pose.stamp_ns, tuple(pose.position.tolist())

    def read_pair(self, left: bytes, right: bytes) -> tuple[int, Position] | None:
        """Return the stamp [ns] and both positions [m], length 6, of two usual poses with one stamp; else None."""
        if len(left) != self._size or len(right) != self._size:
            return None
        head, *one = self._headed.unpack_from(left)
        other_head, *other = self._headed.unpack_from(right)
        if head != other_head or head[:_STAMP_AT] != self._encapsulation or head[12:] != self._frame:
            return None
        seconds, nanoseconds = _STAMP.unpack_from(head, _STAMP_AT)
        if seconds < 0 or nanoseconds >= _SECOND:
            return None
        return seconds * _SECOND + nanoseconds, (*one, *other)
