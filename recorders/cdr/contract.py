"""Tests that every message type passes; needs pytest, and a test class of one's own with a `format` and examples."""

from collections.abc import Sequence
from typing import Any, ClassVar

import pytest

from recorders.cdr.codec import decode, encode, stamp_ns
from recorders.cdr.message_format import FORMATS, MessageFormat
from recorders.cdr.rosbags_types import schema_text, typestore
from recorders.errors import MessageError


class MessageFormatContract:
    """Tests of a type, for a class that inherits them: all that logs, the wire and comparisons rely on.

    Attributes
    ----------
    format : MessageFormat
        The format, which must be registered.
    examples : sequence of messages
        Two or more, no two of them alike.
    """

    format: ClassVar[MessageFormat]
    examples: ClassVar[Sequence[Any]]

    def fields(self, message: Any) -> dict[str, int | float | str]:
        """Return the fields of a message by name."""
        return dict(self.format.fields(message))

    def test_it_is_registered_and_one_of_ros(self) -> None:
        """It is found by its ROS 2 name, and a log has a schema for it."""
        assert self.format.name in FORMATS.names()
        assert FORMATS.find(self.format.name) is self.format
        assert schema_text(self.format.name)

    def test_bytes_are_those_of_another_writer(self) -> None:
        """Messages that rosbags reads in them, it writes as the same bytes."""
        store = typestore()
        for message in self.examples:
            data = encode(message)
            assert bytes(store.serialize_cdr(store.deserialize_cdr(data, self.format.name), self.format.name)) == data

    def test_messages_survive_to_the_bit(self) -> None:
        """In either byte order."""
        store = typestore()
        for message in self.examples:
            data = encode(message)
            other = store.serialize_cdr(
                store.deserialize_cdr(data, self.format.name), self.format.name, little_endian=False
            )
            for written in (data, bytes(other)):
                found = decode(self.format.name, written)
                assert type(found) is self.format.message
                assert encode(found) == data

    def test_a_message_that_is_cut_off_is_refused(self) -> None:
        """Wherever it ends."""
        data = encode(self.examples[0])
        for end in range(len(data)):
            with pytest.raises(MessageError):
                decode(self.format.name, data[:end])

    def test_fields_distinguish_messages(self) -> None:
        """Each field has a name of its own, and is one of the parts that a comparison may leave out."""
        found = [self.fields(message) for message in self.examples]
        assert all(len(list(self.format.fields(message))) == len(self.fields(message)) for message in self.examples)
        assert len({tuple(fields.items()) for fields in found}) == len(self.examples) > 1
        for name in {name for fields in found for name in fields}:
            assert any(_plain(name).startswith(part) for part in self.format.parts), name

    def test_a_header_is_read_without_the_rest(self) -> None:
        """Of a type that has one."""
        for message in self.examples:
            expected = message.stamp_ns if self.format.stamped else None
            assert stamp_ns(self.format.name, encode(message)) == expected


def _plain(name: str) -> str:
    """Return the name of a field without places."""
    return "".join(part.partition("]")[2] if place else part for place, part in enumerate(name.split("[")))
