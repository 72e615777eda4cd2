"""Checks of message fields: what is stored in a frozen message, or one clear line about what is wrong with it."""

import operator
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from recorders.errors import MessageError

FloatArray: TypeAlias = NDArray[np.float64]

MAX_STAMP_NS = 2**31 * 10**9 - 1  # builtin_interfaces/Time holds the seconds in an int32
UINT32_MAX = 2**32 - 1

# A robot's joint names come back in every message: they are checked once, and all messages share one tuple.
_checked_names: dict[tuple[str, ...], tuple[str, ...]] = {}
_MAX_CHECKED = 256

store = object.__setattr__  # the only way to set a field of a frozen instance


def read_only(array: FloatArray) -> FloatArray:
    """Mark `array` as not writable and return it."""
    array.flags.writeable = False
    return array


def wrong(message: object, part: str, expected: str, found: str) -> MessageError:
    """Return the error for a field that is not what it must be."""
    return MessageError(f"{type(message).__name__}.{part}: expected {expected}, found {found}")


def integer(message: object, part: str, value: Any, maximum: int) -> int:
    """Return `value` as an int from 0 to `maximum`; raises MessageError, as all the functions below do."""
    try:
        number = operator.index(value)
    except TypeError:
        raise wrong(message, part, "an integer", repr(value)) from None
    if not 0 <= number <= maximum:
        raise wrong(message, part, f"0 to {maximum}", str(number))
    return number


def stamp(message: object, part: str, value: Any) -> int:
    """Return `value` as a time that ROS can hold [ns]."""
    return integer(message, part, value, MAX_STAMP_NS)


def text(message: object, part: str, value: Any) -> str:
    """Return `value` if it is a string that can be written as UTF-8."""
    if not isinstance(value, str):
        raise wrong(message, part, "a string", repr(value))
    try:
        value.encode()
    except UnicodeEncodeError:
        raise wrong(message, part, "text that UTF-8 can hold", ascii(value)) from None
    return value


def items(message: object, part: str, value: Any) -> Iterable[Any]:
    """Return `value` if it is a sequence and not a string."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise wrong(message, part, "a sequence", repr(value))
    return value


def names(message: object, value: Any) -> tuple[str, ...]:
    """Return joint names as a tuple, the same one for equal names."""
    found = tuple(items(message, "name", value))
    try:
        return _checked_names[found]
    except (KeyError, TypeError):  # not met before, or not hashable and so no strings
        checked = tuple(text(message, "name", name) for name in found)
    if len(_checked_names) >= _MAX_CHECKED:
        _checked_names.clear()
    _checked_names[checked] = checked
    return checked


def vector(message: object, part: str, value: Any, size: int | None = None) -> FloatArray:
    """Return a read-only copy of `value` as float64, shape (size,), or any (n,) without a size."""
    try:
        array = np.array(value, dtype=np.float64)  # always a copy
    except (TypeError, ValueError):
        raise wrong(message, part, "numbers", repr(value)) from None
    if array.ndim != 1 or (size is not None and len(array) != size):
        shape = "(n,)" if size is None else f"({size},)"
        raise wrong(message, part, f"shape {shape}", f"shape {array.shape}")
    return read_only(array)
