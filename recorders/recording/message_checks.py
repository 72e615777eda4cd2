"""Checks of what comes: whether bytes are a message of the type that they are sent as."""

from recorders.cdr.codec import decode
from recorders.cdr.rosbags_types import is_known, typestore
from recorders.errors import MessageError


def decodes(type_name: str, data: bytes) -> bool:
    """Whether bytes are a message of a type of the table of topics."""
    try:
        decode(type_name, data)
    except MessageError:
        return False
    return True


def is_standard(type_name: str, data: bytes) -> bool:
    """Whether bytes are a message of a standard ROS 2 type, as far as rosbags can decide."""
    if not is_known(type_name):
        return False
    try:
        typestore().deserialize_cdr(data, type_name)
    except Exception:  # of any kind: rosbags checks nothing beforehand
        return False
    return True
