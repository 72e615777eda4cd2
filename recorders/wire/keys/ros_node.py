"""A node of ours in the graph of a ROS domain: its tokens."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

import zenoh

from recorders.rmw_zenoh.liveliness import Endpoint, EntityType, Token
from recorders.rmw_zenoh.names import NodeName, check_domain
from recorders.rmw_zenoh.qos import Qos
from recorders.rmw_zenoh.type_hashes import type_hash


class RosNode:
    """A node, with the numbers of what it declares.

    Parameters
    ----------
    domain : int
        The ROS domain.
    name : NodeName
        The node's name, namespace and remapping.

    Raises
    ------
    WireError
        If there is no such domain.
    """

    _numbers = count()  # of nodes; a session of ours has one, a test may have several

    def __init__(self, domain: int, name: NodeName) -> None:
        self.domain = check_domain(domain)
        self.name = name
        self._number = next(self._numbers)
        self._entities = count(1)

    @contextmanager
    def joined(self, session: zenoh.Session) -> Iterator[Token]:
        """Be in the graph while the block runs."""
        token = Token(self.domain, str(session.info.zid()), self._number, self._number, EntityType.NODE, self.name)
        with session.liveliness().declare_token(token.to_key()):
            yield token

    @contextmanager
    def declared(
        self,
        session: zenoh.Session,
        entity: EntityType,
        topic: str,
        type_name: str,
        qos: Qos,
        *,
        definition_hash: str = "",
    ) -> Iterator[Token]:
        """Have a publisher or a subscription in the graph while the block runs.

        Parameters
        ----------
        session : zenoh.Session
            An open session.
        entity : EntityType
            Which of both.
        topic : str
            Topic, as it is in the graph.
        type_name : str
            A ROS 2 type.
        qos : Qos
            Offered or requested.
        definition_hash : str
            RIHS01 hash of the type, if it is no standard one.

        Raises
        ------
        WireError, MessageError
            If topic or type are none of ROS 2.
        """
        endpoint = Endpoint(topic, type_name, definition_hash or type_hash(type_name), qos)
        zid = str(session.info.zid())
        token = Token(self.domain, zid, self._number, next(self._entities), entity, self.name, endpoint)
        with session.liveliness().declare_token(token.to_key()):
            yield token
