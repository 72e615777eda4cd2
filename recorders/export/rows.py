"""Rows of a table out of messages: one for each, a column for each number or text in it."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from recorders.containers.field_values import FieldValues
from recorders.errors import LogError
from recorders.messages.record import RecordedMessage

Row: TypeAlias = dict[str, Any]

LOG_TIME = "log_time_ns"

_OF_JOINTS = ("position", "velocity", "effort")
_MOST_COLUMNS = 4096


def row_of(record: RecordedMessage, values: FieldValues) -> Row:
    """Return the row of a message; raises MessageError if it cannot be decoded.

    Joints have columns of their own, such as `position.elbow`; other rows of values, which may be of any length, are
    one column of JSON.
    """
    return {LOG_TIME: record.log_time_ns, **dict(_columns(values.read(record)))}


def _columns(fields: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    names = fields.get("name")
    of_joints = _OF_JOINTS if isinstance(names, list) and not prefix else ()
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{name}.")
        elif name in of_joints and names is not None and len(value) == len(names):
            yield from ((f"{name}.{joint}", _number(item)) for joint, item in zip(names, value, strict=True))
        elif of_joints and (name == "name" or value == []):
            continue
        else:
            yield f"{prefix}{name}", json.dumps(value) if isinstance(value, list) else _number(value)


def _number(value: Any) -> Any:
    """Return a value as a table has it: a number that JSON lacks is a number again."""
    return float(value) if value in ("NaN", "Infinity", "-Infinity") else value


class Columns:
    """The columns of a table, in the order in which they first appeared, and the type of each.

    Attributes
    ----------
    types : dict of str to type
        `bool`, `int`, `float` or `str` by name.
    """

    def __init__(self) -> None:
        self.types: dict[str, type] = {}

    def add(self, row: Row) -> None:
        """Take in a row; raises LogError if it makes too many columns."""
        for name, value in row.items():
            if value is not None:
                self.types[name] = _common(self.types.get(name), type(value))
        if len(self.types) > _MOST_COLUMNS:
            raise LogError(f"expected at most {_MOST_COLUMNS} columns, found more")

    def values(self, row: Row) -> Sequence[Any]:
        """Return the values of a row by column, None for what it lacks."""
        return [None if (value := row.get(name)) is None else kind(value) for name, kind in self.types.items()]


def _common(known: type | None, found: type) -> type:
    """Return the type that holds values of both."""
    if known is None or known is found:
        return found
    return float if {known, found} == {int, float} else str
