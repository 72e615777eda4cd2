"""Subscriptions of a ROS domain that a stream awaits: before they are there, what is sent would be lost on them."""

import logging
import time
from collections.abc import Callable, Mapping
from functools import partial

from recorders.errors import WireError
from recorders.text.wording import names_text
from recorders.wire.keys.ros_graph import RosGraph
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import MessagePublisher
from recorders.wire.session import Session, has_subscribers

logger = logging.getLogger(__name__)

_RETRY_S = 0.01


def await_subscriptions(
    session: Session,
    keys: RosKeys,
    wanted: Mapping[str, int],
    publishers: Mapping[str, tuple[str, MessagePublisher]],
    *,
    is_latched: Callable[[str], bool],
    wait_s: float,
) -> None:
    """Wait until topics have so many subscriptions each, by the graph, and what is put reaches one of them.

    What is awaited, and how many there are before and after, is logged.

    Parameters
    ----------
    session : Session
        An open session.
    keys : RosKeys
        The domain.
    wanted : mapping of str to int
        How many subscriptions are awaited, by topic.
    publishers : mapping of str to (str, MessagePublisher)
        Type and publisher of the topics.
    is_latched : callable
        Whether a topic's publisher keeps its messages for late joiners.
    wait_s : float
        How long that may take for all together [s].

    Raises
    ------
    WireError
        If it takes longer, or nothing is sent on such a topic.
    """
    for topic in wanted:
        if topic not in publishers:
            there = names_text(sorted(publishers)) or "none"
            raise WireError(f"--wait-for {topic}: expected a topic that is sent, found none; there are: {there}")
    deadline_s = time.monotonic() + wait_s
    with RosGraph(session, keys.domain) as graph:
        for topic, number in wanted.items():
            kind, publisher = publishers[topic]
            left_s, name = max(0.0, deadline_s - time.monotonic()), keys.graph_name(topic)
            found = partial(graph.subscriptions, name, kind)
            logger.info(f"waits for subscriptions of {name} ({kind}): {found()} of {number} there")
            graph.wait_for(name, number, timeout_s=left_s, type_name=kind)
            while not (is_latched(topic) or has_subscribers(publisher)):
                if time.monotonic() > deadline_s:
                    raise WireError(
                        f"{topic}: its subscriptions are there, but nothing that is put reaches one within {wait_s:g} s"
                    )
                time.sleep(_RETRY_S)
            logger.info(f"subscriptions of {name}: {found()} there")
