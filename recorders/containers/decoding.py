"""Decoding of the messages of any log into ours, by the encoding and the definitions of their channels."""

import json
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias, cast

from recorders.cdr.codec import decode, stamp_ns
from recorders.cdr.message_format import FORMATS
from recorders.cdr.stream import CdrReader
from recorders.containers.conversions import CONVERSIONS, convert
from recorders.containers.definitions import channel_definitions, is_standard, ros_name
from recorders.containers.ros_values import RosReader, ros1_stamp_ns
from recorders.errors import MessageError, MissingExtra, ReenactError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import Message, PoseStamped, TransformStamped
from recorders.messages.record import RecordedMessage

ReadFields: TypeAlias = Callable[[bytes], Mapping[str, Any]]


class Decoding(NamedTuple):
    """How the messages of a channel become ours.

    Attributes
    ----------
    type : str
        Our type that they come out as.
    decode : callable
        Makes one of the bytes; raises MessageError.
    as_it_is : bool
        Whether the bytes are CDR of that type already.
    """

    type: str
    decode: Callable[[bytes], Message]
    as_it_is: bool


class MessageDecoder:
    """Decodes the messages of a log: joints, poses, transforms, texts and numbers of any encoding.

    Poses and points of every type come out as `PoseStamped`; those without a stamp have the stamp 0.

    Parameters
    ----------
    channels : iterable of DeclaredChannel
        The channels of the log.

    Attributes
    ----------
    types : dict of str to str
        Topics that are decoded, and the type of our message that each comes out as.
    """

    def __init__(self, channels: Iterable[DeclaredChannel]) -> None:
        self._decodings: dict[str, Decoding] = {}
        self._failed: dict[str, ReenactError] = {}
        for channel in channels:
            try:
                found = find_decoding(channel)
            except ReenactError as error:
                self._failed[channel.topic] = error
                continue
            if found is not None:
                self._decodings[channel.topic] = found
        self.types = {topic: found.type for topic, found in self._decodings.items()}

    def decode(self, record: RecordedMessage) -> Message:
        """Return a message of the log as ours.

        Raises
        ------
        MessageError
            If its topic is of another type, its definition cannot be read, or the bytes are none of it.
        MissingExtra
            If its encoding needs a package that is not installed.
        """
        found = self._decodings.get(record.topic)
        if found is None:
            none = f"expected joints, poses, transforms, texts or numbers, found {record.type or 'no type'}"
            error = self._failed.get(record.topic, MessageError(none))
            raise error if isinstance(error, MissingExtra) else MessageError(f"{record.topic}: {error}")
        return found.decode(record.data)


def find_decoding(channel: DeclaredChannel) -> Decoding | None:
    """Return how the messages of a channel become ours; None if their type is not needed.

    Raises
    ------
    MessageError
        If its definition cannot be read.
    MissingExtra
        If its encoding needs a package that is not there.
    """
    name = channel.type if channel.type.startswith("foxglove.") else ros_name(channel.type)
    if channel.encoding in ("cdr", "") and FORMATS.get(name) is not None and is_standard(channel):
        return Decoding(name, lambda data: decode(name, data), as_it_is=True)
    if name not in CONVERSIONS or channel.encoding not in _READERS:
        return None
    our_type = CONVERSIONS[name][0]
    read = _READERS[channel.encoding](channel, name)
    return Decoding(our_type, lambda data: convert(name, read(data)), as_it_is=False)


def pose_decoding(channel: DeclaredChannel) -> Decoding | None:
    """Return how messages of a channel become poses: those of odometry, transforms, poses and points of other types.

    Poses without a stamp have the stamp 0. None for poses already, and for whatever is none; raises as `find_decoding`.
    """
    found = find_decoding(channel)
    if found is not None and found.type == TransformStamped.TYPE:
        decode_transform = found.decode
        return Decoding(PoseStamped.TYPE, lambda data: _pose_of(decode_transform(data)), as_it_is=False)
    return None if found is None or found.as_it_is or found.type != PoseStamped.TYPE else found


def _pose_of(message: Message) -> PoseStamped:
    transform = cast(TransformStamped, message)
    return PoseStamped(
        transform.stamp_ns, transform.translation, orientation=transform.rotation, frame_id=transform.frame_id
    )


def field_reader(channel: DeclaredChannel) -> ReadFields:
    """Return what reads the fields of a channel's messages, of any type.

    Raises
    ------
    MessageError
        If its definition or encoding cannot be read. From what is returned: if the bytes are no message of the type.
    MissingExtra
        If its encoding needs a package that is not installed.
    """
    find = _READERS.get(channel.encoding or "cdr")
    if find is None or not channel.type:
        found = f"{channel.type or 'none'} in {channel.encoding or 'none'}"
        raise MessageError(f"expected a type in one of the encodings {', '.join(_READERS)}, found {found:.200}")
    return find(channel, channel.type if channel.encoding in ("json", "protobuf") else ros_name(channel.type))


def stamp_reader(channel: DeclaredChannel) -> Callable[[bytes], int | None]:
    """Return what reads the stamps of a channel's messages [ns], of any type that has some, and None where it has none.

    What is returned raises MessageError if the bytes are no message of the type.
    """
    if channel.encoding == "cdr" and (FORMATS.get(channel.type) is not None or not _begins_with_header(channel)):
        return lambda data: stamp_ns(channel.type, data)
    if channel.encoding == "cdr":
        return lambda data: CdrReader(data).time_ns()
    if channel.encoding == "ros1" and _begins_with_header(channel):
        return ros1_stamp_ns
    try:
        found = find_decoding(channel)
    except ReenactError:
        return lambda data: None
    return lambda data: None if found is None else getattr(found.decode(data), "stamp_ns", None)


def _begins_with_header(channel: DeclaredChannel) -> bool:
    try:
        _, fields = channel_definitions(channel).get(ros_name(channel.type), ((), ()))
    except MessageError:
        return False
    return bool(fields) and fields[0][1][1] == "std_msgs/msg/Header"


def _ros_reader(channel: DeclaredChannel, name: str) -> ReadFields:
    return RosReader(channel_definitions(channel), name, channel.encoding).read


def _json_reader(channel: DeclaredChannel, name: str) -> ReadFields:
    def read(data: bytes) -> Mapping[str, Any]:
        try:
            fields = json.loads(data)
        except (ValueError, RecursionError):
            raise MessageError(f"{name}: expected JSON, found none") from None
        if not isinstance(fields, dict):
            raise MessageError(f"{name}: expected an object of JSON, found another value")
        return fields

    return read


def _protobuf_reader(channel: DeclaredChannel, name: str) -> ReadFields:
    try:
        from recorders.containers.protobuf_values import protobuf_reader  # noqa: PLC0415  # of an extra
    except ModuleNotFoundError:
        raise MissingExtra("mcap_protobuf", "foxglove") from None
    return protobuf_reader(channel, name)


_READERS: dict[str, Callable[[DeclaredChannel, str], ReadFields]] = {
    "cdr": _ros_reader,
    "ros1": _ros_reader,
    "json": _json_reader,
    "protobuf": _protobuf_reader,
}

ENCODINGS = frozenset(_READERS) - {"cdr"}
"""Encodings that are decoded, beside CDR."""
