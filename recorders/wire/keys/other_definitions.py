"""Publishers whose messages a subscription does not get, as they have another definition of its type."""

import logging
from collections.abc import Collection, Iterator
from contextlib import contextmanager

import zenoh

from recorders.errors import WireError
from recorders.rmw_zenoh.liveliness import Token, publishers_of
from recorders.text.once import OnceWarner
from recorders.wire.session import watching_tokens

logger = logging.getLogger(__name__)

_MAX_LINES = 10  # anyone may declare a publisher


@contextmanager
def reporting_other_definitions(
    session: zenoh.Session, domain: int, topic: str, type_name: str, hashes: Collection[str]
) -> Iterator[None]:
    """Report whoever publishes on a topic with another definition of its type while the block runs, each node once.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    domain : int
        The ROS domain.
    topic : str
        Topic, as it is in the graph.
    type_name : str
        A ROS 2 type.
    hashes : collection of str
        What stands in the keys that are subscribed to.
    """
    warnings = OnceWarner(logger, limit=_MAX_LINES)

    def on_change(key: str, is_there: bool) -> None:
        """Look at a publisher that comes."""
        try:
            token = Token.from_key(key)
        except WireError:
            return
        if is_there and token.endpoint is not None and token.endpoint.type_hash not in hashes:
            warnings.warn(
                f"{topic}: {token.node.full_name} publishes another definition of {type_name}: its messages do not come"
            )

    with watching_tokens(session, publishers_of(domain, topic, type_name), on_change, history=True):
        yield
