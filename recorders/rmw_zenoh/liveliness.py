"""Liveliness tokens, by which nodes, publishers and subscriptions are in the graph of a ROS domain."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import xxhash

from recorders.errors import MessageError, WireError
from recorders.rmw_zenoh.names import NodeName, check_domain, check_topic
from recorders.rmw_zenoh.qos import Qos
from recorders.rmw_zenoh.type_hashes import dds_type, ros_type

_ADMIN = "@ros2_lv"
_MAX_TOKEN = 4096  # characters; anyone may declare one


class EntityType(StrEnum):
    """The type of what a token stands for."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


@dataclass(frozen=True)
class Endpoint:
    """A topic's side of a token.

    Parameters
    ----------
    topic : str
        Absolute name of the topic, or of the service.
    type : str
        ROS 2 type.
    type_hash : str
        RIHS01 hash of that type.
    qos : Qos
        Offered or requested quality of service.
    """

    topic: str
    type: str
    type_hash: str
    qos: Qos


@dataclass(frozen=True)
class Token:
    """A liveliness token of rmw_zenoh.

    Parameters
    ----------
    domain : int
        The ROS domain.
    session : str
        Zenoh's identifier of the session.
    node_id, entity_id : int
        Numbers of the node and of the entity in that session; a node's own are equal.
    entity : EntityType
        What it stands for.
    node : NodeName
        The node.
    endpoint : Endpoint, optional
        Topic and type; None for a node.
    """

    domain: int
    session: str
    node_id: int
    entity_id: int
    entity: EntityType
    node: NodeName
    endpoint: Endpoint | None = None

    def to_key(self) -> str:
        """Return the key that is declared; raises WireError or MessageError for names that ROS 2 does not take."""
        parts = [_ADMIN, str(check_domain(self.domain)), self.session, str(self.node_id), str(self.entity_id)]
        parts += [self.entity, "%", mangle(self.node.namespace), mangle(self.node.name)]
        if self.endpoint is not None:
            end = self.endpoint
            parts += [mangle(check_topic(end.topic)), dds_type(end.type), end.type_hash, end.qos.to_token()]
        return "/".join(parts)

    @property
    def gid(self) -> bytes:
        """The 16 bytes that name a publisher in what it attaches: the hash of its token, as rmw_zenoh has it."""
        return xxhash.xxh3_128_intdigest(self.to_key().encode()).to_bytes(16, "little")

    @classmethod
    def from_key(cls, key: str) -> Self:
        """Read a token.

        Raises
        ------
        WireError
            If it is none: anyone may declare what they like.
        """
        parts = key.split("/")
        if len(key) > _MAX_TOKEN or parts[0] != _ADMIN or len(parts) not in (9, 13) or "" in parts:
            raise WireError(f"expected a liveliness token of rmw_zenoh, found {key[:100]!r}")
        try:
            entity = EntityType(parts[5])
            node = NodeName(demangle(parts[8]).lstrip("/"), _absolute(demangle(parts[7])))
            if (entity is EntityType.NODE) != (len(parts) == 9):
                raise ValueError(f"{len(parts)} parts of a token for {entity}")
            endpoint = None if entity is EntityType.NODE else _endpoint(*parts[9:])
            return cls(check_domain(int(parts[1])), parts[2], int(parts[3]), int(parts[4]), entity, node, endpoint)
        except (ValueError, MessageError, WireError) as error:
            raise WireError(f"expected a liveliness token of rmw_zenoh, found {key[:100]!r} ({error})") from error


def tokens_of(domain: int, entity: EntityType | None = None) -> str:
    """Return the key expression of all tokens of a domain, or of those of one type."""
    check_domain(domain)
    return f"{_ADMIN}/{domain}/**" if entity is None else f"{_ADMIN}/{domain}/*/*/*/{entity}/**"


def publishers_of(domain: int, topic: str, type_name: str) -> str:
    """Return the key expression of the tokens of all publishers of a topic, as it is in the graph, of one type."""
    check_domain(domain)
    return f"{_ADMIN}/{domain}/*/*/*/{EntityType.PUBLISHER}/*/*/*/{mangle(topic)}/{dds_type(type_name)}/*/*"


def mangle(name: str) -> str:
    """Return a name as one part of a key: `%` for `/`, and for nothing."""
    return name.replace("/", "%") or "%"


def demangle(part: str) -> str:
    """Return the name that `mangle` made a part of."""
    return part.replace("%", "/")


def _absolute(name: str) -> str:
    return name if name.startswith("/") else "/" + name


def _endpoint(topic: str, type_name: str, type_hash: str, qos: str) -> Endpoint:
    return Endpoint(_absolute(demangle(topic)), ros_type(type_name), type_hash, Qos.from_token(qos))
