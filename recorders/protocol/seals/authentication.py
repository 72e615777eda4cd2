"""Seals that prove who sent a packet: AES-GMAC under a key of one stream and one direction.

A seal is the number of the packet among all that its maker sealed, and a tag over that number and everything that the
packet means. NIST SP 800-38D asks that no number be used twice with one key: whoever seals counts what it has sealed,
whatever it is, also what it sends again.
"""

import struct
from collections.abc import Callable
from functools import lru_cache
from itertools import count

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

KEY_BYTES = 32
"""Size of a key, a shared one or one of a stream [bytes]."""

INSTANCE_BYTES = 16
"""Size of what distinguishes a consumer from others of its name, before and after it [bytes]."""

_SEAL = struct.Struct("<Q16s")  # number, tag
_LENGTHS = tuple(struct.Struct(f"<{count}Q") for count in range(8))


def sender_key(shared: bytes, sender: bytes) -> bytes:
    """Return the key under which a sender seals, from the shared one and the 16 fresh bytes that name the sender."""
    return _derived(shared, sender, b"reenact 2 sender")


def consumer_key(shared: bytes, sender: bytes, consumer: str, instance: bytes) -> bytes:
    """Return the key under which a consumer seals for one sender; `instance` is fresh whenever a consumer starts."""
    return _derived(shared, sender, b"reenact 2 consumer" + instance + consumer.encode())


class Signer:
    """Seals under one key.

    Parameters
    ----------
    key : bytes
        The key.
    next_number : callable
        Returns another number whenever it is called; keys may share it, and no two signers may share a key without it.
    """

    def __init__(self, key: bytes, next_number: Callable[[], int] | None = None) -> None:
        self._cipher = AESGCM(key)
        self._next_number = next_number or count().__next__

    def seal(self, *parts: bytes) -> bytes:
        """Return the seal of some parts."""
        number = self._next_number()
        return _SEAL.pack(number, self._cipher.encrypt(_nonce(number), b"", _joined(parts)))


class Verifier:
    """Checks seals under one key.

    Parameters
    ----------
    key : bytes
        The key.
    """

    def __init__(self, key: bytes) -> None:
        self._cipher = AESGCM(key)

    def number(self, seal: bytes, *parts: bytes) -> int | None:
        """Return the number of a seal; None if it is not the seal of these parts."""
        if len(seal) != _SEAL.size:
            return None
        number, tag = _SEAL.unpack(seal)
        try:
            self._cipher.decrypt(_nonce(number), tag, _joined(parts))
        except InvalidTag:
            return None
        return int(number)


def seal_number(seal: bytes) -> int:
    """Return the number in a seal."""
    return int(_SEAL.unpack(seal)[0])


@lru_cache(maxsize=256)  # of streams that are asked for again and again
def _derived(shared: bytes, salt: bytes, info: bytes) -> bytes:
    return HKDF(algorithm=SHA256(), length=KEY_BYTES, salt=salt, info=info).derive(shared)


def _nonce(number: int) -> bytes:
    return number.to_bytes(12, "big")


def _joined(parts: tuple[bytes, ...]) -> bytes:
    """Return the parts as one, with their lengths before them: no other parts come to the same."""
    return b"".join((_LENGTHS[len(parts)].pack(*map(len, parts)), *parts))
