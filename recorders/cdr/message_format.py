"""The seam for message types: how messages of one are read from CDR, written to it, and named field by field.

A type is a module with `FORMAT`, a `MessageFormat`: here in `recorders.cdr.types`, or in a distribution of others,
under an entry point of the group `reenact.messages` that has the name of the type. `recorders.cdr.contract` has tests
for it. Its schema in a log is ROS 2's, so it is one of the standard types.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from recorders.cdr import types
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.validation import FloatArray
from recorders.registry import Registry

Value: TypeAlias = int | float | str
"""Value of a field of a message."""


@dataclass(frozen=True)
class MessageFormat:
    """Format of one message type.

    Parameters
    ----------
    message : type
        Its class: a frozen dataclass with the ROS 2 name of the type as `TYPE`; a type with a header has `stamp_ns`.
    read : callable
        Reads a message from a `CdrReader`.
    write : callable
        Writes a message to a `CdrWriter`.
    fields : callable
        Yields the fields of a message, by the names that ROS gives them, in their order.
    parts : tuple of str
        Names of the fields without places: what a comparison may leave out.
    """

    message: type[Any]
    read: Callable[[CdrReader], Any]
    write: Callable[[CdrWriter, Any], None]
    fields: Callable[[Any], Iterable[tuple[str, Value]]]
    parts: tuple[str, ...]

    @property
    def name(self) -> str:
        """ROS 2 name of the type."""
        return str(self.message.TYPE)

    @property
    def stamped(self) -> bool:
        """Whether messages begin with a header."""
        return "stamp_ns" in getattr(self.message, "__dataclass_fields__", {})


FORMATS = Registry(
    "message type", MessageFormat, room=types, constant="FORMAT", group="reenact.messages", named_as_module=False
)


HEADER_PARTS = ("header.stamp", "header.frame_id")


def write_header(writer: CdrWriter, stamp_ns: int, frame_id: str) -> None:
    """Write a std_msgs/Header."""
    writer.time_ns(stamp_ns)
    writer.string(frame_id)


def header_fields(message: Any, prefix: str = "") -> Iterator[tuple[str, Value]]:
    """Yield the fields of a message's header."""
    yield f"{prefix}header.stamp", message.stamp_ns
    yield f"{prefix}header.frame_id", message.frame_id


def components(name: str, axes: Iterable[str], values: FloatArray) -> Iterator[tuple[str, Value]]:
    """Yield the numbers of a vector, each by the name of its axis."""
    return ((f"{name}.{axis}", value) for axis, value in zip(axes, values.tolist(), strict=True))
