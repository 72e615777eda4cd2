"""Channels of a ROS graph as rosbag2 writes them into MCAP, and the quality of service that they state."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from recorders.cdr.rosbags_types import is_known, schema_text
from recorders.mcap_format.channels import DeclaredChannel
from recorders.rmw_zenoh.qos import Qos, qos_text, read_qos_text, strictest, usual_qos
from recorders.rmw_zenoh.type_hashes import UNKNOWN_HASH, type_hash

QOS_METADATA = "offered_qos_profiles"
"""Metadata of a channel in which rosbag2 states the quality of service that its publishers offered."""

HASH_METADATA = "topic_type_hash"
"""Metadata of a channel in which rosbag2 states the RIHS01 hash of its type."""

_NO_SCHEMA = ("unknown", "", b"")


def bag_channel(topic: str, type_name: str, hash_text: str, profiles: Sequence[Qos]) -> DeclaredChannel:
    """Return the channel of a topic of the graph.

    Parameters
    ----------
    topic : str
        Absolute name of the topic.
    type_name : str
        ROS 2 type of its messages.
    hash_text : str
        RIHS01 hash of that type, as its publishers state it.
    profiles : sequence of Qos
        What they offer.

    Returns
    -------
    DeclaredChannel
        Without the text of a definition where the type is none of ROS 2's own, or another of its name.
    """
    stated = "" if hash_text == UNKNOWN_HASH else hash_text
    metadata = ((QOS_METADATA, qos_text(profiles) if profiles else ""), (HASH_METADATA, stated))
    return DeclaredChannel(topic, "cdr", metadata, schema_of_type(type_name, stated))


def schema_of_type(type_name: str, hash_text: str) -> tuple[str, str, bytes]:
    """Return the schema of a type: with its definition if that is known, which has this hash, if one is stated."""
    if not is_known(type_name) or hash_text not in ("", type_hash(type_name)):
        return type_name, "", b""
    return type_name, "ros2msg", schema_text(type_name).encode()


def has_definition(channel: DeclaredChannel) -> bool:
    """Whether a channel has the text of its type's definition."""
    return channel.schema is not None and bool(channel.schema[2])


def with_schema(topic: str, type_name: str, declared: DeclaredChannel | None) -> DeclaredChannel | None:
    """Return the channel of a message with a schema of no text if it would have none: rosbag2 opens no such file.

    Parameters
    ----------
    topic : str
        Its topic.
    type_name : str
        Its type; an empty string if that is unknown.
    declared : DeclaredChannel, optional
        Its channel in another log, or in a graph.
    """
    if declared is not None and declared.schema is None:
        return replace(declared, schema=_NO_SCHEMA)
    if declared is None and not type_name:
        return DeclaredChannel(topic, "application/octet-stream", schema=_NO_SCHEMA)
    return declared


def stated_qos(channels: Iterable[DeclaredChannel], topic: str) -> Qos:
    """Return what a publisher offers in place of those whose messages were recorded on a topic.

    Of a topic whose recorder stated nothing it is what ROS 2 has for that topic: latched descriptions, and transforms
    that do not change; rclcpp's default for any other.

    Raises
    ------
    WireError
        If a channel states something else than profiles.
    """
    of_topic = [channel for channel in channels if channel.topic == topic]
    texts = dict.fromkeys(dict(channel.metadata).get(QOS_METADATA, "") for channel in of_topic)
    if profiles := [profile for text in texts for profile in read_qos_text(text)]:
        return strictest(profiles)
    return usual_qos(topic)
