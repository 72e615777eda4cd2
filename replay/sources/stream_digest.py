"""The stream digest: what a learner was fed, as one hash that any transport must reproduce."""

import hashlib
import struct
from collections.abc import Iterable

from recorders.messages.record import RecordedMessage

_FRAME = struct.Struct("<HII")  # topic length, sequence, data length


def frame_for_digest(record: RecordedMessage) -> bytes:
    """Return topic, sequence and bytes of a message, unambiguously joined. Its log time does not enter."""
    return digest_link((record,))


def digest_link(records: Iterable[RecordedMessage]) -> bytes:
    """Return what one link of the stream digest hashes: a tick's records in canonical order, or one phase marker."""
    parts: list[bytes] = []
    for name, _, data, sequence, _ in records:
        topic = name.encode()
        parts += _FRAME.pack(len(topic), sequence, len(data)), topic, data
    return b"".join(parts)


class StreamDigest:
    """Chained SHA-256 over completed ticks and phase markers.

    Each link hashes the digest before it and the records of one tick in canonical order, so that the 32 bytes of
    the digest are all there is to keep in a checkpoint.

    Parameters
    ----------
    value : bytes
        Digest to go on from, 32 bytes; zeros at the start of a stream.

    Examples
    --------
    >>> whole, first = StreamDigest(), StreamDigest()
    >>> whole.extend([b"tick 0", b"tick 1"])
    >>> first.extend([b"tick 0"])
    >>> rest = StreamDigest(first.value)
    >>> rest.extend([b"tick 1"])
    >>> rest.value == whole.value
    True
    """

    def __init__(self, value: bytes = bytes(32)) -> None:
        self._value = value

    def update(self, records: Iterable[RecordedMessage]) -> None:
        """Add one link: the records of a completed tick, in canonical order, or one phase marker."""
        self.extend((digest_link(records),))

    def extend(self, links: Iterable[bytes]) -> None:
        """Add links that were joined beforehand, by `digest_link`."""
        value = self._value
        for data in links:
            value = hashlib.sha256(value + data).digest()
        self._value = value

    @property
    def value(self) -> bytes:
        """The digest, 32 bytes."""
        return self._value

    def hexdigest(self) -> str:
        """Return the digest as 64 hexadecimal digits."""
        return self._value.hex()
