"""Plain CDR (XCDR1): numbers, strings and sequences read from bytes and written to them, with alignment.

The first four bytes name the byte order; every number is aligned to its own size, counted from the fifth byte.
Reading never trusts a length: each is checked against what is left before anything is allocated.
"""

import struct

import numpy as np

from recorders.errors import MessageError
from recorders.messages.validation import MAX_STAMP_NS, FloatArray
from recorders.text.wording import value_text

ENCAPSULATION = b"\x00\x01\x00\x00"  # plain CDR, little-endian, no options
_HEADER_SIZE = len(ENCAPSULATION)
_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_SECOND = 10**9
_MAX_PADDING = 3  # some writers pad the payload to a multiple of four


class CdrReader:
    """A place in a CDR payload, moved forward by each read.

    Raises
    ------
    MessageError
        From every method, if the payload is not CDR or ends too early.
    """

    def __init__(self, data: bytes) -> None:
        order = _BYTE_ORDERS.get(data[:2])
        if order is None or len(data) < _HEADER_SIZE:
            raise MessageError(f"expected plain CDR (00 00 or 00 01 and two more bytes), found {data[:4].hex(' ')!r}")
        self._body = data[_HEADER_SIZE:]
        self._place = 0
        self._uint32 = struct.Struct(order + "I")
        self._int32 = struct.Struct(order + "i")
        self._float64 = np.dtype(order + "f8")

    def uint32(self) -> int:
        """Read an unsigned integer of 32 bits."""
        self._align(4)
        value: int = self._uint32.unpack(self._take(4))[0]
        return value

    def time_ns(self) -> int:
        """Read a builtin_interfaces/Time as nanoseconds."""
        self._align(4)
        seconds: int = self._int32.unpack(self._take(4))[0]
        nanoseconds = self.uint32()
        if seconds < 0 or nanoseconds >= _SECOND:
            raise MessageError(f"expected a time from 0 on, found {seconds} s and {nanoseconds} ns")
        return seconds * _SECOND + nanoseconds

    def string(self) -> str:
        """Read a string of UTF-8, which ends in a zero byte that its length counts."""
        raw = self._take(self.uint32())
        if raw and raw[-1]:
            raise MessageError("expected a string that ends in a zero byte, found one that does not")
        try:
            return raw[:-1].decode()
        except UnicodeDecodeError:
            raise MessageError(f"expected a string of UTF-8, found {value_text(raw[:40])}") from None

    def float64s(self, count: int) -> FloatArray:
        """Read `count` floats to the bit, shape (count,)."""
        if count:
            self._align(8)
        raw = self._take(8 * count)
        return np.frombuffer(raw, self._float64).astype("<f8", copy=False)

    def finish(self) -> None:
        """Check that nothing but padding is left."""
        left = len(self._body) - self._place
        if left > _MAX_PADDING:
            raise MessageError(f"expected the end of the message, found {left} more bytes")

    def _align(self, size: int) -> None:
        self._place += -self._place % size

    def _take(self, size: int) -> bytes:
        start = self._place
        self._place += size
        if self._place > len(self._body):
            raise MessageError(f"message cut off: expected {size} bytes at {start}, found {len(self._body) - start}")
        return self._body[start : self._place]


class CdrWriter:
    """A little-endian CDR payload that grows with each write.

    Attributes
    ----------
    runs : list of (int, int)
        Where each run of floats starts and ends, counted from the fifth byte of the payload.
    """

    def __init__(self) -> None:
        self._body = bytearray()
        self.runs: list[tuple[int, int]] = []

    def uint32(self, value: int) -> None:
        """Write an unsigned integer of 32 bits."""
        self._align(4)
        self._body += value.to_bytes(4, "little")

    def time_ns(self, stamp_ns: int) -> None:
        """Write nanoseconds, 0 to 2^31 s, as a builtin_interfaces/Time."""
        if not 0 <= stamp_ns <= MAX_STAMP_NS:
            raise MessageError(f"expected a time from 0 to 2^31 s, found {stamp_ns} ns")
        seconds, nanoseconds = divmod(stamp_ns, _SECOND)
        self.uint32(seconds)
        self.uint32(nanoseconds)

    def string(self, text: str) -> None:
        """Write a string."""
        raw = text.encode()
        self.uint32(len(raw) + 1)
        self._body += raw + b"\x00"

    def float64s(self, values: FloatArray) -> None:
        """Write floats to the bit, without their count."""
        if len(values):
            self._align(8)
        start = len(self._body)
        self._body += values.astype("<f8", copy=False).tobytes()
        self.runs.append((start, len(self._body)))

    def payload(self) -> bytes:
        """Return the whole payload."""
        return ENCAPSULATION + bytes(self._body)

    def _align(self, size: int) -> None:
        self._body += bytes(-len(self._body) % size)
