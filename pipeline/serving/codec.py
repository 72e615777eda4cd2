"""The two messages that a served controller cannot do without, read and written with as little ado as can be.

What is here takes the bytes that are constant from the codec itself, and leaves to it whatever is unusual.
"""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.learner.rules.reservoir.kernels import STAMP_AT
from recorders.cdr.codec import decode_as, encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

Floats = NDArray[np.float64]
Position = tuple[float, ...]
"""Of one hand [m], length 3."""

_STAMP = struct.Struct("<iI")  # s and ns, behind the four bytes of the encapsulation
_SECOND = 10**9


class Command(NamedTuple):
    """One joint command and what it answers.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the targets, and of the command [ns].
    data : bytes
        The command, a JointState as CDR.
    answered : tuple of RecordedMessage
        The messages of the tick: left target, right target and, when learning, the joints.
    """

    stamp_ns: int
    data: bytes
    answered: tuple[RecordedMessage, ...]


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
    stamp : ndarray of uint8, shape (8,)
        Its stamp, as CDR has it, to be written to likewise.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        payload = encode(JointState(0, joints, np.zeros(len(joints))))
        first = len(payload) - 8 - 8 * len(joints)  # behind them the lengths of velocities and efforts: there are none
        padding = -first % 8  # the positions begin at a multiple of eight bytes
        memory = bytearray(padding) + payload
        self._payload = memoryview(memory)[padding:]
        self.positions: Floats = np.frombuffer(memory, np.float64, len(joints), padding + first)
        self.stamp = np.frombuffer(memory, np.uint8, _STAMP.size, padding + STAMP_AT)

    def encode(self, stamp_ns: int) -> bytes:
        """Return a JointState as CDR, the bytes that `recorders.cdr.codec.encode` gives, with a stamp [ns]."""
        _STAMP.pack_into(self._payload, STAMP_AT, *divmod(stamp_ns, _SECOND))
        return self.encoded()

    def encoded(self) -> bytes:
        """Return the JointState as it stands."""
        return bytes(self._payload)


def pose_layout() -> tuple[bytes, int]:
    """Return a PoseStamped in the world frame as CDR, and where its position begins: 3 float64 [m], then 4 more."""
    payload = encode(PoseStamped(0, np.zeros(3)))
    return payload, len(payload) - 7 * 8


class PoseReader:
    """Reads stamp and position out of poses in the world frame without making a message; others it decodes."""

    def __init__(self) -> None:
        payload, position_at = pose_layout()
        self._size = len(payload)
        frame = position_at - STAMP_AT - _STAMP.size  # the bytes between the stamp and the position
        self._layout = struct.Struct(f"<4siI{frame}s3d")
        self._encapsulation, _, _, self._frame, *_ = self._layout.unpack_from(payload)

    def read(self, data: bytes) -> tuple[int, Position]:
        """Return stamp [ns] and position [m] of a PoseStamped; raises MessageError if it is none."""
        if len(data) == self._size:
            encapsulation, seconds, nanoseconds, frame, x, y, z = self._layout.unpack_from(data)
            usual = encapsulation == self._encapsulation and frame == self._frame
            if usual and seconds >= 0 and nanoseconds < _SECOND:
                return seconds * _SECOND + nanoseconds, (x, y, z)
        pose = decode_as(PoseStamped, data)
        return pose.stamp_ns, tuple(pose.position.tolist())
