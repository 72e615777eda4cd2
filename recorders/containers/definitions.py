"""Message types by the definitions that a log carries: the fields of each, in order."""

import re
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any, TypeAlias

from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from recorders.errors import MessageError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.rmw_zenoh.bag_channels import HASH_METADATA
from recorders.rmw_zenoh.type_hashes import is_type_hash

Definitions: TypeAlias = Mapping[str, Any]
"""Constants and fields of types by ROS 2 name, as rosbags parses them."""

_MOST_TEXT = 2**18  # bytes of one definition with all that it contains: the longest of ROS take a tenth
_SEPARATOR = "=" * 80 + "\n"
_SHORT = re.compile(r"^=+$", re.MULTILINE)  # separators of some writers are shorter


def ros_name(type_name: str) -> str:
    """Return the name that a type has in ROS 2: `sensor_msgs/JointState` is `sensor_msgs/msg/JointState`."""
    package, _, rest = type_name.partition("/")
    return type_name if not rest or "/" in rest else f"{package}/msg/{rest}"


@cache
def standard_definitions(ros: int) -> Definitions:
    """Return the standard types of ROS 1 or 2, for logs that carry no definitions."""
    return get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE).fielddefs


@lru_cache(maxsize=256)
def channel_definitions(channel: DeclaredChannel) -> Definitions:
    """Return the types that a channel's schema defines, or the standard ones if it defines none that can be read.

    Raises
    ------
    MessageError
        If the definition does not parse, and the type is none of ROS's own.
    """
    name, encoding, data = channel.schema or ("", "", b"")
    ros = 1 if channel.encoding == "ros1" else 2
    if not data.strip():
        return standard_definitions(ros)
    if len(data) > _MOST_TEXT:
        raise MessageError(f"{name:.80}: expected a definition of at most {_MOST_TEXT} bytes, found {len(data)}")
    try:
        text = data.decode()
        found = _from_idl(text) if "idl" in encoding else get_types_from_msg(_usual(text), ros_name(name))
    except (TypesysError, ValueError, RecursionError, AssertionError, KeyError, IndexError, TypeError):
        if ros_name(name) in standard_definitions(ros):
            return standard_definitions(ros)  # whether messages are of it is seen when they are decoded
        raise MessageError(f"{name:.80}: its definition in the log cannot be read as {encoding or 'ros2msg'}") from None
    times = {key: value for key, value in standard_definitions(2).items() if key.startswith("builtin_interfaces/")}
    return {**times, **found}


def definition_hash(channel: DeclaredChannel) -> str:
    """Return the RIHS01 hash of a channel's type: as it states it, or of its definition; empty if neither is there."""
    stated = dict(channel.metadata).get(HASH_METADATA, "")
    if is_type_hash(stated):
        return stated
    name = ros_name(channel.type)
    try:
        store = get_typestore(Stores.EMPTY)
        store.register(dict(channel_definitions(channel)))
        return str(store.hash_rihs01(name))
    except (MessageError, TypesysError, KeyError, ValueError, RecursionError):
        return ""


def is_standard(channel: DeclaredChannel) -> bool:
    """Whether the definition of a channel's type is that of ROS 2, field by field, or there is none to differ."""
    if channel.schema is None or not channel.schema[2].strip():
        return True
    standard = standard_definitions(2)
    return all(
        name not in standard or _fields(fields) == _fields(standard[name])
        for name, fields in channel_definitions(channel).items()
    )


def _fields(definition: Any) -> list[tuple[str, str]]:
    return [(name.lower(), str(kind)) for name, kind in definition[1]]


def _usual(text: str) -> str:
    return _SHORT.sub("=" * 80, text.replace("\r\n", "\n"))


def _from_idl(text: str) -> Definitions:
    if not text.startswith(_SEPARATOR):
        return get_types_from_idl(text)
    parts = (part.partition("\n")[2] for part in text.split(_SEPARATOR)[1:])
    return {name: fields for part in parts for name, fields in get_types_from_idl(part).items()}
