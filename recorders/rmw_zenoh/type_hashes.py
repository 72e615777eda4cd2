"""Types as rmw_zenoh writes them: the DDS name, and the RIHS01 hash of the definition (REP 2016)."""

import re
from functools import cache

from recorders.cdr.rosbags_types import schema_text, typestore
from recorders.errors import MessageError

_ROS_TYPE = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")
_DDS_TYPE = re.compile(r"([a-z][a-z0-9_]*)::(msg|srv|action)::dds_::([A-Za-z][A-Za-z0-9_]*)_")
_HASH = re.compile(r"RIHS01_[0-9a-f]{64}")

UNKNOWN_HASH = "TypeHashNotSupported"
"""What stands in keys and tokens for a hash where nobody knows any: in ROS 2 Humble."""


def dds_type(type_name: str) -> str:
    """Return the DDS name of a ROS 2 type: `std_msgs::msg::dds_::String_` of `std_msgs/msg/String`.

    Raises
    ------
    MessageError
        If it is no name of a ROS 2 type.
    """
    found = _ROS_TYPE.fullmatch(type_name)
    if found is None:
        raise MessageError(f"expected a ROS 2 type such as std_msgs/msg/String, found {type_name[:100]!r}")
    return "{}::{}::dds_::{}_".format(*found.groups())


def ros_type(dds_name: str) -> str:
    """Return the ROS 2 type of a DDS name; raises MessageError if that is none."""
    found = _DDS_TYPE.fullmatch(dds_name)
    if found is None:
        raise MessageError(f"expected a DDS type such as std_msgs::msg::dds_::String_, found {dds_name[:100]!r}")
    return "/".join(found.groups())


def is_type_hash(text: str) -> bool:
    """Whether a text is a RIHS01 hash."""
    return _HASH.fullmatch(text) is not None


def ends_key(text: str) -> bool:
    """Whether a text is what a key ends with: a RIHS01 hash, or what stands there where nobody knows any."""
    return text == UNKNOWN_HASH or is_type_hash(text)


@cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of a standard ROS 2 type.

    Raises
    ------
    MessageError
        If ROS 2 has no such standard type.
    """
    schema_text(type_name)
    return str(typestore().hash_rihs01(type_name))
