"""Values of protobuf messages, by the descriptors that their log carries; needs the extra `foxglove`."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from recorders.errors import MessageError
from recorders.mcap_format.channels import DeclaredChannel


class ProtobufFields(Mapping[str, Any]):
    """Fields of a protobuf message by name, as they are asked for; one that is optional and not set is None."""

    def __init__(self, message: Any) -> None:
        self._message = message
        self._fields = message.DESCRIPTOR.fields_by_name

    def __getitem__(self, name: str) -> Any:
        field = self._fields[name]
        value = getattr(self._message, name)
        if field.is_repeated:
            return [_plain(item) for item in value]
        if field.has_presence and field.message_type is None and not self._message.HasField(name):
            return None
        return _plain(value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)


def protobuf_reader(channel: DeclaredChannel, name: str) -> Callable[[bytes], Mapping[str, Any]]:
    """Return what reads the fields of a channel's messages.

    Raises
    ------
    MessageError
        If the channel's schema holds no descriptor of the type. From what is returned: if the bytes are no message.
    """
    schema_name, encoding, data = channel.schema or ("", "", b"")
    try:
        decode = DecoderFactory().decoder_for("protobuf", Schema(1, data, encoding, schema_name))
    except (McapError, DecodeError, ValueError, TypeError, KeyError, RuntimeError):
        decode = None
    if decode is None:
        raise MessageError(f"{name}: expected a schema with its protobuf descriptor, found none")

    def read(data: bytes) -> Mapping[str, Any]:
        try:
            return ProtobufFields(decode(data))
        except (DecodeError, ValueError, RuntimeError):
            raise MessageError(f"{name}: expected a protobuf message, found none") from None

    return read


def _plain(value: Any) -> Any:
    return ProtobufFields(value) if hasattr(value, "DESCRIPTOR") else value
