"""What is lost and what is back: said with the time, for the endpoint and for nodes behind it, and only then."""

import logging
import queue
import re
from collections.abc import Iterator
from contextlib import ExitStack
from logging.handlers import QueueHandler

import pytest
from visitor import await_ready, visitor
from waiting import wait_until

from recorders.nodes.connection_watch import logger, watching_connections
from recorders.nodes.keys import NodeId, node_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

OWN = NodeId("recorder", "recorder")
WAIT_S = 120.0

Lines = queue.SimpleQueue[logging.LogRecord]


@pytest.fixture
def lines() -> Iterator[Lines]:
    """What is logged, from now on."""
    found: Lines = queue.SimpleQueue()
    handler = QueueHandler(found)
    logger.addHandler(handler)
    yield found
    logger.removeHandler(handler)


def test_an_endpoint_that_is_killed_is_lost_and_back_with_the_time(lines: Lines) -> None:
    endpoint = free_endpoint()
    config = SessionConfig(connect=(endpoint,), wait_s=WAIT_S)
    with ExitStack() as stack:
        first = stack.enter_context(visitor("idle", listen=[endpoint]))
        session = stack.enter_context(open_session(config))
        await_ready(first)
        stack.enter_context(watching_connections(session, config, own=OWN, namespace="reenact"))
        first.kill()
        assert moment(lines.get(timeout=WAIT_S).getMessage()) == ("lost", endpoint)
        stack.enter_context(visitor("idle", listen=[endpoint]))
        assert moment(lines.get(timeout=WAIT_S).getMessage()) == ("back", endpoint)
    assert lines.empty()


def moment(line: str) -> tuple[str, str]:
    """Return what has become of what, by a line that names the time too."""
    found = re.fullmatch(r"(lost|back) (\S+) at \d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d\d:\d\d", line)
    assert found is not None, line
    return found[1], found[2]


def test_nodes_that_end_only_when_they_are_told_to_are_missed_and_no_others(lines: Lines) -> None:
    endpoint = free_endpoint()
    config = SessionConfig(listen=(endpoint,))
    own = NodeId("controller", "mine")
    with open_session(config) as session, open_session(SessionConfig(connect=(endpoint,))) as far, ExitStack() as stack:
        token = far.liveliness().declare_token
        there = token(node_key("lab", "robot", "asimo", "alive"))
        passing = token(node_key("lab", "replay", "0a1b", "alive"))
        foreign = token("lab/@node/robot/\x1b[2J/alive")
        mine = token(node_key("lab", *own, "alive"))
        wait_until(lambda: len(list(session.liveliness().get("lab/**/@node/**", timeout=1.0))) == 4)
        stack.enter_context(watching_connections(session, config, own=own, namespace="lab"))
        for gone in (passing, foreign, mine, there):
            gone.undeclare()
        assert lines.get(timeout=WAIT_S).getMessage().startswith("lost robot asimo at ")
        stack.enter_context(token(node_key("lab", "robot", "asimo", "alive")))
        assert lines.get(timeout=WAIT_S).getMessage().startswith("back robot asimo at ")
    assert lines.empty()


@pytest.mark.parametrize("kind", ["robot", "controller"])
def test_what_ends_with_the_one_that_watches_is_not_lost(
    kind: str, lines: Lines, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorders.nodes.connection_watch._LOST", ("lost", logging.WARNING, WAIT_S))  # soon enough
    config = SessionConfig(listen=(free_endpoint(),))
    with open_session(config) as session:
        gone = session.liveliness().declare_token(node_key("lab", kind, "anna", "alive"))
        with watching_connections(session, config, own=OWN, namespace="lab"):
            gone.undeclare()
    assert lines.empty()
