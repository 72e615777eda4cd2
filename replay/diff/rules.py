"""Rules for comparing two logs: bit for bit, or by value but for some fields and a tolerance."""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase

from recorders.cdr.message_format import FORMATS, Value
from recorders.errors import ConfigError, MessageError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from replay.diff.fields import (
    FieldDifference,
    differing_byte,
    differing_field,
    differing_value,
    fields_of,
    format_pair,
)

SEQUENCE, TYPE, LOG_TIME = "sequence", "type", "log_time"

_PLACE = re.compile(r"\[[^]]*\]| \(.*\)")  # of an element, and the joint that it belongs to


def known_fields() -> tuple[str, ...]:
    """Return the fields that can be left out, without places: those of messages, and what goes with them."""
    parts = (part for name in FORMATS.names() for part in FORMATS.find(name).parts)
    return tuple(dict.fromkeys((SEQUENCE, TYPE, LOG_TIME, *parts)))


@dataclass(frozen=True)
class Rules:
    """How two messages are compared.

    Parameters
    ----------
    ignored : tuple of str
        Fields that do not count, such as `sequence`, `header`, `effort` or `position[3]`; patterns.
    tolerance : float, optional
        How far two numbers may be apart [unit of the field]. With it, or with fields that are ignored, messages are
        compared by value: bytes that no field shows, such as padding, do not count.

    Raises
    ------
    ConfigError
        If a field is none, or the tolerance is out of range.
    """

    ignored: tuple[str, ...] = ()
    tolerance: float | None = None

    def __post_init__(self) -> None:
        """Check names and range."""
        known = known_fields() if self.ignored else ()
        for name in self.ignored:
            if not any(_names(name, field) or _names(field, _plain(name)) for field in known):
                raise ConfigError(f"--ignore: expected a topic or one of {', '.join(known)}, found {name[:80]!r}")
        if self.tolerance is not None and not 0.0 <= self.tolerance < float("inf"):
            raise ConfigError(f"--tolerance: expected a number from 0 up, found {self.tolerance}")

    @property
    def numbered(self) -> bool:
        """Whether sequence numbers count."""
        return not self._ignores(SEQUENCE)

    def same(self, a: RecordedMessage, b: RecordedMessage) -> bool:
        """Whether two messages are the same; the time of recording never enters."""
        return a[:4] == b[:4] or (not self._exact and self._difference(a, b) is None)

    def difference(self, a: RecordedMessage, b: RecordedMessage) -> FieldDifference:
        """Return the first thing that differs between two messages of one topic that are not the same."""
        return (None if self._exact else self._difference(a, b)) or differing_field(a, b)

    @property
    def _exact(self) -> bool:
        return not self.ignored and self.tolerance is None

    def _difference(self, a: RecordedMessage, b: RecordedMessage) -> FieldDifference | None:
        if a.topic != b.topic:
            return FieldDifference("topic", *format_pair(a.topic, b.topic))
        if a.type != b.type and not self._ignores(TYPE):
            return FieldDifference(TYPE, *format_pair(a.type, b.type))
        if a.sequence != b.sequence and self.numbered:
            return FieldDifference(SEQUENCE, *format_pair(a.sequence, b.sequence))
        try:
            values = [fields_of(record._replace(type=record.type or type_of(record.topic))) for record in (a, b)]
        except MessageError:
            return differing_byte(a.data, b.data) if a.data != b.data else None
        left, right = ({name: value for name, value in each.items() if not self._ignores(name)} for each in values)
        return differing_value(left, right, same=self._close)

    def _close(self, a: Value, b: Value) -> bool:
        if not (isinstance(a, float) and isinstance(b, float)):
            return a == b
        return a == b or (a != a and b != b) or abs(a - b) <= (self.tolerance or 0.0)  # NaN

    def _ignores(self, field: str) -> bool:
        return any(_names(name, field) for name in self.ignored)


EXACT = Rules()
"""Everything counts, to the bit."""


def _names(pattern: str, field: str) -> bool:
    """Whether a pattern names a field, all the parts of which it is one, or all the elements of which it is one."""
    full, plain = field.partition(" ")[0], _plain(field)
    return any(name == pattern or name.startswith(f"{pattern}.") for name in (full, plain)) or any(
        fnmatchcase(name, pattern) for name in (field, plain)
    )


def _plain(field: str) -> str:
    return _PLACE.sub("", field)
