"""Values of ROS messages of any type out of their bytes, CDR or ROS 1, by the definitions of their log.

Nothing that a log defines is executed, and no length that it states is believed: each is checked against what is left.
"""

import struct
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from recorders.containers.definitions import Definitions
from recorders.errors import MessageError

Values: TypeAlias = dict[str, Any]
"""Fields of a message by name: numbers, texts, arrays, lists, and fields of fields."""

_Read: TypeAlias = Callable[["_Bytes"], Any]

_NUMBERS = {
    "bool": "?",
    "byte": "B",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_DEEPEST = 16  # levels of types within types: those of ROS have six
_ENCAPSULATION = 4
_ROS1_HEADER = struct.Struct("<III")  # sequence, stamp in s and ns
_CDR_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


class RosReader:
    """Reads messages of one type.

    Parameters
    ----------
    definitions : mapping
        The fields of the type and of those that it contains.
    type_name : str
        Its ROS 2 name.
    encoding : str
        `cdr` or `ros1`.

    Raises
    ------
    MessageError
        If a type is not defined, or holds what cannot be read.
    """

    def __init__(self, definitions: Definitions, type_name: str, encoding: str) -> None:
        self._type_name = type_name
        self._cdr = encoding == "cdr"
        self._definitions = definitions
        self._known: dict[str, tuple[_Read, int]] = {}
        self._read, _ = self._type(type_name, 0)

    def read(self, data: bytes) -> Values:
        """Return the fields of a message; raises MessageError if the bytes are none of this type."""
        try:
            source = _cdr_bytes(data) if self._cdr else _Bytes(data, "<", aligned=False)
            values: Values = self._read(source)
        except (struct.error, UnicodeDecodeError) as error:
            raise MessageError(f"{self._type_name}: not a message of this type: {error}") from None
        except MessageError as error:
            raise MessageError(f"{self._type_name}: {error}") from None
        if source.left > (3 if self._cdr else 0):
            raise MessageError(f"{self._type_name}: expected the end of the message, found {source.left} more bytes")
        return values

    def _type(self, name: str, depth: int) -> tuple[_Read, int]:
        """Return what reads a type, and the fewest bytes that it takes."""
        if name in self._known:
            return self._known[name]
        if name not in self._definitions:
            raise MessageError(f"the log does not define the type {name:.80}")
        if depth > _DEEPEST:
            raise MessageError(f"{self._type_name}: types within types, more than {_DEEPEST} deep")
        fields = [(field, *self._field(kind, depth)) for field, kind in self._definitions[name][1]]
        readers = tuple((field, read) for field, read, _ in fields)

        def read_fields(source: "_Bytes") -> Values:
            return {field: read(source) for field, read in readers}

        self._known[name] = read_fields, sum(size for _, _, size in fields)
        return self._known[name]

    def _field(self, kind: Any, depth: int) -> tuple[_Read, int]:
        node, about = kind
        if node == Nodetype.NAME:
            return self._type(about, depth + 1)
        if node == Nodetype.BASE:
            return self._base(about[0])
        (inner_node, inner), count = about
        fixed = count if node == Nodetype.ARRAY else None
        if inner_node == Nodetype.BASE and inner[0] in _NUMBERS:
            return self._numbers(_NUMBERS[inner[0]], fixed)
        read, size = self._field((inner_node, inner), depth)
        if not size:
            raise MessageError(f"{self._type_name}: a row of what takes no bytes")

        def read_row(source: "_Bytes") -> list[Any]:
            count = source.count(size) if fixed is None else fixed
            return [read(source) for _ in range(count)]

        return read_row, 4 if fixed is None else fixed * size

    def _base(self, name: str) -> tuple[_Read, int]:
        if name == "string":
            return (_Bytes.cdr_text, 5) if self._cdr else (_Bytes.text, 4)
        if name not in _NUMBERS:
            raise MessageError(f"{self._type_name}: expected numbers and texts, found {name:.40}")
        code = _NUMBERS[name]
        return (lambda source: source.number(code)), struct.calcsize(code)

    def _numbers(self, code: str, fixed: int | None) -> tuple[_Read, int]:
        size = struct.calcsize(code)
        if fixed is not None:
            return (lambda source: source.array(code, fixed)), fixed * size
        return (lambda source: source.array(code, source.count(size))), 4


def ros1_stamp_ns(data: bytes) -> int:
    """Return the stamp [ns] of a message of ROS 1 that begins with a header; raises MessageError if it is too short."""
    if len(data) < _ROS1_HEADER.size:
        raise MessageError(f"message cut off: expected a header, found {len(data)} bytes")
    _, seconds, nanoseconds = _ROS1_HEADER.unpack_from(data)
    return int(seconds) * 10**9 + int(nanoseconds)


class _Bytes:
    """A place in the bytes of a message, moved forward by each read."""

    def __init__(self, data: bytes, order: str, *, aligned: bool) -> None:
        self._data, self._order, self._aligned = data, order, aligned
        self._place = 0

    @property
    def left(self) -> int:
        """Bytes that are left."""
        return len(self._data) - self._place

    def number(self, code: str) -> Any:
        """Read one number."""
        form = _FORMS[self._order + code]
        place = self._align(form.size)
        self._place = place + form.size
        return form.unpack_from(self._data, place)[0]

    def count(self, size: int) -> int:
        """Read how many follow of what takes so many bytes each, at least."""
        count: int = self.number("I")
        if count * size > self.left:
            raise MessageError(f"message cut off: expected {count} values, found {self.left} bytes")
        return count

    def array(self, code: str, count: int) -> Any:
        """Read numbers in a row."""
        kind = np.dtype(self._order + code)
        place = self._align(kind.itemsize) if count else self._place
        end = place + count * kind.itemsize
        if end > len(self._data):
            raise MessageError(f"message cut off: expected {count} numbers, found {self.left} bytes")
        self._place = end
        return np.frombuffer(self._data, kind, count, place)

    def text(self) -> str:
        """Read a text."""
        size = self.count(1)
        self._place += size
        return self._data[self._place - size : self._place].decode()

    def cdr_text(self) -> str:
        """Read a text that ends in a zero byte, which its length counts."""
        return self.text().removesuffix("\0")

    def _align(self, size: int) -> int:
        return self._place + (-self._place % size if self._aligned else 0)


_FORMS = {order + code: struct.Struct(order + code) for order in "<>" for code in set(_NUMBERS.values())}


def _cdr_bytes(data: bytes) -> _Bytes:
    order = _CDR_ORDERS.get(data[:2])
    if order is None or len(data) < _ENCAPSULATION:
        raise MessageError(f"expected plain CDR (00 00 or 00 01 and two more bytes), found {data[:4].hex(' ')!r}")
    return _Bytes(data[_ENCAPSULATION:], order, aligned=True)
