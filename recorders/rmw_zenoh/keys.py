"""Keys of messages: `DOMAIN/topic/pkg::msg::dds_::Type_/RIHS01_...`."""

from typing import NamedTuple

from recorders.errors import MessageError
from recorders.rmw_zenoh.names import MAX_DOMAIN, check_domain, check_topic
from recorders.rmw_zenoh.type_hashes import dds_type, ends_key, ros_type


class TopicKey(NamedTuple):
    """What the key of a message states.

    Attributes
    ----------
    domain : int
        The ROS domain.
    topic : str
        Absolute name of the topic.
    type : str
        ROS 2 type of its messages.
    type_hash : str
        RIHS01 hash of that type's definition, or what stands there for one in ROS 2 Humble.
    """

    domain: int
    topic: str
    type: str
    type_hash: str

    def to_text(self) -> str:
        """Return the key.

        Raises
        ------
        WireError, MessageError
            If one of the parts cannot be in a key of rmw_zenoh.
        """
        check_domain(self.domain)
        if not ends_key(self.type_hash):
            raise MessageError(f"{self.topic}: expected a hash RIHS01_..., found {self.type_hash[:100]!r}")
        return f"{self.domain}{check_topic(self.topic)}/{dds_type(self.type)}/{self.type_hash}"

    @classmethod
    def from_text(cls, key: str) -> "TopicKey":
        """Read a key; a topic may have any name here, as whoever publishes it answers for it.

        Raises
        ------
        MessageError
            If it is no key of rmw_zenoh.
        """
        domain, *names = key.split("/")
        if len(names) < 3 or not (domain.isascii() and domain.isdigit()) or len(domain) > 3 or int(domain) > MAX_DOMAIN:
            raise MessageError(f"expected DOMAIN/topic/type/hash, found {key[:100]!r}")
        *topic, type_name, type_hash = names
        if not ends_key(type_hash):
            raise MessageError(f"expected a hash RIHS01_... at the end of the key, found {type_hash[:100]!r}")
        return cls(int(domain), "/" + "/".join(topic), ros_type(type_name), type_hash)
