"""Difference of two messages: the first field whose bits are not the same, with both values as text."""

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from recorders.cdr.codec import decode
from recorders.cdr.message_format import FORMATS, Value
from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage

ABSENT = "absent"
_BITS = struct.Struct(">d")
_LONGEST = 60  # characters of a text that are shown
_BEFORE = 20  # of them before the first that differs


class FieldDifference(NamedTuple):
    """A field, such as `pose.position.x` or `position[3] (left_elbow)`, and what it holds on either side."""

    field: str
    a: str
    b: str


def differing_field(a: RecordedMessage, b: RecordedMessage) -> FieldDifference:
    """Return the first thing that differs between two messages of one topic that are not the same.

    Type and sequence come first, then the fields in the order of the message, floats to the bit. Where messages do
    not decode, or differ in none of their fields (in padding, in byte order), it is the first byte.
    """
    if a.type != b.type:
        return FieldDifference("type", *format_pair(a.type, b.type))
    if a.sequence != b.sequence:
        return FieldDifference("sequence", *format_pair(a.sequence, b.sequence))
    try:
        difference = differing_value(fields_of(a), fields_of(b))
    except MessageError:
        difference = None
    return difference or differing_byte(a.data, b.data)


def fields_of(record: RecordedMessage) -> dict[str, Value]:
    """Return the fields of a message by the names that ROS gives them, in their order; raises as `decode` does."""
    message = decode(record.type, record.data)
    return dict(FORMATS.find(record.type).fields(message))


def format_pair(a: Value, b: Value) -> tuple[str, str]:
    """Return both values as text: numbers in full precision, with their bits if that looks alike."""
    if isinstance(a, str) and isinstance(b, str):
        return _excerpts(a, b)
    if isinstance(a, float) and isinstance(b, float) and repr(a) == repr(b):
        return f"{a!r} (0x{_BITS.pack(a).hex()})", f"{b!r} (0x{_BITS.pack(b).hex()})"
    return repr(a), repr(b)


def _same(a: Value, b: Value) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return _BITS.pack(a) == _BITS.pack(b)  # a NaN equals itself, and -0.0 is not 0.0
    return a == b


def differing_value(
    a: Mapping[str, Value], b: Mapping[str, Value], *, same: Callable[[Value, Value], bool] = _same
) -> FieldDifference | None:
    """Return the first field that only one side has, or in which both are not the same: to the bit by default."""
    for name in {**a, **b}:
        if name not in b:
            return FieldDifference(name, repr(a[name]), ABSENT)
        if name not in a:
            return FieldDifference(name, ABSENT, repr(b[name]))
        if not same(a[name], b[name]):
            return FieldDifference(name, *format_pair(a[name], b[name]))
    return None


def differing_byte(a: bytes, b: bytes) -> FieldDifference:
    """Return the first byte in which two messages differ that do differ."""
    offset = _common(a, b)
    return FieldDifference(f"bytes[{offset}]", _byte(a, offset), _byte(b, offset))


def _common(a: Sequence[object], b: Sequence[object]) -> int:
    """Return how long the beginning is that both share."""
    differs = (place for place, (x, y) in enumerate(zip(a, b, strict=False)) if x != y)
    return next(differs, min(len(a), len(b)))


def _byte(data: bytes, offset: int) -> str:
    return f"0x{data[offset]:02x}" if offset < len(data) else f"the end after {len(data)} bytes"


def _excerpts(a: str, b: str) -> tuple[str, str]:
    """Return two texts quoted; of long ones what stands around the first character that differs."""
    start = max(0, _common(a, b) - _BEFORE) if max(len(a), len(b)) > _LONGEST else 0
    return _excerpt(a, start), _excerpt(b, start)


def _excerpt(text: str, start: int) -> str:
    end = start + _LONGEST
    return ("…" if start else "") + repr(text[start:end]) + ("…" if end < len(text) else "")
