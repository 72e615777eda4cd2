"""A digest of every message of a stream from an index on, which both of its ends take and compare."""

import hashlib
import struct

from recorders.messages.topics import type_of
from recorders.protocol.frames import Frame, FrameType, records

_ENTRY = struct.Struct("<Q32s")  # start, digest
_PIECE = 2047  # the most that hashlib hashes without letting other threads run [bytes]
_LARGE = 1 << 16  # from here on others may run meanwhile [bytes]


class StreamDigest:
    """SHA-256 over the messages from a stream index on, as a batch of them travels, however they are cut.

    Parameters
    ----------
    start : int
        Stream index of the first message.

    Attributes
    ----------
    at : int
        The index after the last message that is in it.
    """

    def __init__(self, start: int) -> None:
        self._hash = hashlib.sha256()
        self.at = start

    def add(self, frame: Frame, packed: bytes = b"") -> None:
        """Add what is new of a frame; one before which something is missing adds nothing.

        Parameters
        ----------
        frame : Frame
            The frame.
        packed : bytes, optional
            All of its messages as a batch of them travels, if they are at hand.
        """
        if not frame.first <= self.at < frame.end:
            return
        if not packed or frame.first < self.at:
            messages = frame.messages[self.at - frame.first :]
            if frame.kind is FrameType.MESSAGE:  # of which the type travels only where the topic has none
                messages = tuple(each._replace(type=type_of(each.topic) or each.type) for each in messages)
            packed = records(messages)
        self._update(packed)
        self.at = frame.end

    def digest(self) -> bytes:
        """Return the digest so far, 32 bytes."""
        return self._hash.digest()

    def _update(self, packed: bytes) -> None:
        """Hash some bytes, without a change of threads where they are few: whoever drives a machine holds its lock."""
        pieces, size = memoryview(packed), len(packed)
        step = _PIECE if size < _LARGE else size
        for place in range(0, size, step):
            self._hash.update(pieces[place : place + step])


class StreamDigests:
    """Digests of one stream from each index from which a consumer takes it."""

    def __init__(self) -> None:
        self._by_start: dict[int, StreamDigest] = {}
        self._starts: dict[str, int] = {}

    def begin(self, consumer: str, start: int) -> None:
        """Take the digest for a consumer that takes the stream from an index on."""
        self._starts[consumer] = start
        self._by_start.setdefault(start, StreamDigest(start))

    def add(self, frame: Frame, packed: bytes = b"") -> None:
        """Add what is new of a frame to each; see `StreamDigest.add`."""
        for digest in self._by_start.values():
            digest.add(frame, packed)

    def digest(self, consumer: str) -> str:
        """Return the digest of what was sent to a consumer, in hexadecimal."""
        return self._by_start[self._starts[consumer]].digest().hex()

    def packed(self) -> bytes:
        """Return all of them as they travel with the end."""
        starts = sorted(set(self._starts.values()))
        return b"".join(_ENTRY.pack(start, self._by_start[start].digest()) for start in starts)


def find_digest(packed: bytes, start: int) -> str:
    """Return the digest from an index on of those that came with the end; an empty string if it is not there."""
    if len(packed) % _ENTRY.size:
        return ""
    return next((digest.hex() for found, digest in _ENTRY.iter_unpack(packed) if found == start), "")
