"""Rows of a table out of messages: one for each, a column for each number or text in it."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from recorders.containers.field_values import FieldValues, plain
from recorders.errors import LogError
from recorders.messages.record import RecordedMessage

Row: TypeAlias = dict[str, Any]

LOG_TIME = "log_time_ns"

_OF_JOINTS = ("position", "velocity", "effort")
_MOST_COLUMNS = 4096
_UNSIGNED = 2**63  # the first whole number that 64 bits hold only without a sign


def row_of(record: RecordedMessage, values: FieldValues) -> Row:
    """Return the row of a message; raises MessageError if it cannot be decoded.

    Joints have columns of their own, such as `position.elbow`, unless two have one name; other rows of values, which
    may be of any length, are one column of JSON.
    """
    return {LOG_TIME: record.log_time_ns, **dict(_columns(values.read(record, as_json=False)))}


def _columns(fields: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    names = [] if prefix else _joint_names(fields.get("name"))
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{name}.")
        elif not isinstance(value, list):
            yield f"{prefix}{name}", value
        elif names and name in _OF_JOINTS and len(value) == len(names):
            yield from ((f"{name}.{joint}", _cell(item)) for joint, item in zip(names, value, strict=True))
        elif not (names and (name == "name" or value == [])):
            yield f"{prefix}{name}", _cell(value)


def _joint_names(value: Any) -> list[str]:
    """Return the names of joints in a field `name`; none if it holds others, or one of them twice."""
    is_names = isinstance(value, list) and all(isinstance(name, str) for name in value)
    return value if is_names and len(set(value)) == len(value) else []


def _cell(value: Any) -> Any:
    return json.dumps(plain(value)) if isinstance(value, list | dict) else value


class Columns:
    """The columns of a table, in the order in which they first appeared, and the type of each.

    Attributes
    ----------
    types : dict of str to type
        `bool`, `int`, `float` or `str` by name; whole numbers fit 64 bits.
    """

    def __init__(self) -> None:
        self.types: dict[str, type] = {}
        self._least: dict[str, int] = {}
        self._greatest: dict[str, int] = {}

    def add(self, row: Row) -> None:
        """Take in a row; raises LogError if it makes too many columns."""
        for name, value in row.items():
            if value is not None:
                self.types[name] = _common(self.types.get(name), self._type_with(name, value))
        if len(self.types) > _MOST_COLUMNS:
            raise LogError(f"expected at most {_MOST_COLUMNS} columns, found more")

    def is_unsigned(self, name: str) -> bool:
        """Whether a column of whole numbers needs the 64th bit for them."""
        return self._greatest.get(name, 0) >= _UNSIGNED

    def values(self, row: Row) -> Sequence[Any]:
        """Return the values of a row by column, None for what it lacks."""
        return [None if (value := row.get(name)) is None else kind(value) for name, kind in self.types.items()]

    def _type_with(self, name: str, value: Any) -> type:
        """Return the type of a value; that of texts for a whole number that no 64 bits hold with the others."""
        if type(value) is not int:
            return type(value)
        least = self._least[name] = min(value, self._least.get(name, 0))
        greatest = self._greatest[name] = max(value, self._greatest.get(name, 0))
        return int if least >= (0 if greatest >= _UNSIGNED else -_UNSIGNED) and greatest < 2 * _UNSIGNED else str


def _common(known: type | None, found: type) -> type:
    """Return the type that holds values of both."""
    if known is None or known is found:
        return found
    return float if {known, found} == {int, float} else str
