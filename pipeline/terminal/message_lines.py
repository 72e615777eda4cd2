"""Messages as lines: for people, or one JSON object each."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from recorders.containers.field_values import FieldValues
from recorders.errors import ReenactError
from recorders.messages.record import RecordedMessage
from recorders.text.quantities import seconds_text
from recorders.text.wording import escape_control

_SHOWN = 40  # values of a row
_LONGEST = 2000  # characters of a text


class MessageLines:
    """Writes messages as lines.

    Parameters
    ----------
    values : FieldValues
        What reads their fields.
    as_json : bool
        Whether each is one JSON object, with nothing left out.
    """

    def __init__(self, values: FieldValues, *, as_json: bool) -> None:
        self._values, self._as_json = values, as_json

    def text(self, record: RecordedMessage) -> str:
        """Return the lines of a message; of one that cannot be decoded its size, and why."""
        try:
            fields, error = self._values.read(record), None
        except ReenactError as found:
            fields, error = {}, str(found)
        if self._as_json:
            return _json(record, fields, error)
        begin = f"{seconds_text(record.log_time_ns)} s  {record.topic}  {record.type or '-'}  #{record.sequence}"
        lines = [f"{len(record.data)} bytes: {error}"] if error else _lines(fields)
        return escape_control(begin) + "".join(f"\n    {escape_control(line)}" for line in lines)


def _json(record: RecordedMessage, fields: Mapping[str, Any], error: str | None) -> str:
    found = {
        "topic": record.topic,
        "type": record.type,
        "log_time_ns": record.log_time_ns,
        "sequence": record.sequence,
        "message": None if error else fields,
    }
    return json.dumps(found | ({"error": error, "bytes": len(record.data)} if error else {}), allow_nan=False)


def _lines(fields: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield a line for each field, by its name with those of what holds it."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _lines(value, f"{prefix}{name}.")
        elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            for place, item in enumerate(value[:_SHOWN]):
                yield from _lines(item if isinstance(item, Mapping) else {"": item}, f"{prefix}{name}[{place}].")
            if len(value) > _SHOWN:
                yield f"{prefix}{name}: {len(value) - _SHOWN} more"
        else:
            yield f"{prefix}{name}: {_value(value)}"


def _value(value: Any) -> str:
    if isinstance(value, list):
        more = f", ... ({len(value)} values)" if len(value) > _SHOWN else ""
        return (", ".join(map(_value, value[:_SHOWN])) or "-") + more
    text = "-" if value is None or value == "" else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({len(text)} characters)"
