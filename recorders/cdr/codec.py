"""The CDR codec: messages to the bytes of the log and back, to the last bit of every float64."""

from typing import TypeVar, cast

from recorders.cdr.layouts import read_message, write_message
from recorders.cdr.message_format import FORMATS
from recorders.cdr.stream import CdrReader
from recorders.cdr.templates import decode_known, encode_joints, encode_pose, learn_layout, read_stamp
from recorders.messages.message_types import JointState, Message, PoseStamped, TypedMessage

AnyMessage = TypeVar("AnyMessage", bound=TypedMessage)

_USUAL_STAMPED_TYPES = frozenset((JointState.TYPE, PoseStamped.TYPE))


def encode(message: TypedMessage) -> bytes:
    """Return a message as little-endian CDR, byte-identical to what ROS 2 writes.

    Raises
    ------
    MessageError
        If it is of no registered type.

    Examples
    --------
    >>> from recorders.messages.message_types import String
    >>> decode("std_msgs/msg/String", encode(String("here")))
    String(data='here')
    """
    message_class = type(message)
    if message_class is JointState:
        return encode_joints(message)  # type: ignore[arg-type]  # mypy does not narrow on a stored type
    if message_class is PoseStamped:
        return encode_pose(message)  # type: ignore[arg-type]
    return write_message(message).payload()


def decode(type_name: str, data: bytes) -> Message:
    """Return the message that CDR bytes of either byte order hold; its arrays are read-only.

    Parameters
    ----------
    type_name : str
        ROS 2 type name, such as `sensor_msgs/msg/JointState`.
    data : bytes
        The payload.

    Raises
    ------
    MessageError
        If the type is not registered, or the bytes are not a message of it.
    """
    known = decode_known(type_name, data)
    if known is not None:
        return known
    message = read_message(type_name, data)
    if isinstance(message, JointState | PoseStamped):
        learn_layout(message, data)
    return message


def decode_as(message_class: type[AnyMessage], data: bytes) -> AnyMessage:
    """Return the message of a given class that CDR bytes hold; raises MessageError as `decode` does."""
    return cast(AnyMessage, decode(message_class.TYPE, data))


def stamp_ns(type_name: str, data: bytes) -> int | None:
    """Return the header's stamp [ns] without decoding the rest; None for a type that begins with no header.

    Raises
    ------
    MessageError
        If the type has a header and the bytes do not begin with one.
    """
    if type_name not in _USUAL_STAMPED_TYPES and not _is_stamped(type_name):
        return None
    stamp = read_stamp(data)
    return CdrReader(data).time_ns() if stamp is None else stamp


def _is_stamped(type_name: str) -> bool:
    known = FORMATS.get(type_name)
    return known is not None and known.stamped
