"""The exception of a signal leaves no thread running, wherever it cuts short the block that the thread belongs to."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import cache

import pytest
from cut_short import cut_everywhere
from waiting import wait_until

from pipeline.robot.config import load_robot
from pipeline.serving.background_writer import BackgroundWriter
from recorders.nodes.connection_watch import watching_connections
from recorders.nodes.status import NodeSource, declared_node
from recorders.protocol.sender import SenderMachine
from recorders.protocol.stream import Offer
from recorders.threads import background_thread
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.sender import StreamSender
from recorders.wire.session import Session, SessionConfig, open_session

Block = Callable[[Session], AbstractContextManager[object]]


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    with open_session(SessionConfig()) as opened:
        yield opened
    wait_until(lambda: not any("pyo3" in thread.name for thread in threading.enumerate()))


def thread(_session: Session) -> AbstractContextManager[object]:
    over = threading.Event()
    return background_thread(over.wait, name="waits", stop=over.set)


def stream(session: Session) -> AbstractContextManager[object]:
    offer = Offer(run="ab" * 16, schedule={}, logs=[], sender="cd" * 16)
    machine = SenderMachine(offer, ("learner",), key=bytes(32), batched=False, wait_s=60.0, patience_s=60.0)
    return StreamSender(session, NamespaceKeys(), machine, ("learner",), encoding=str).running()


def writer(_session: Session) -> AbstractContextManager[object]:
    return BackgroundWriter(None).running()


def node(session: Session) -> AbstractContextManager[object]:
    source = NodeSource("robot", "asimo", state=lambda: "stands", counts=dict)
    return declared_node(session, source, namespace="reenact")


def connections(session: Session) -> AbstractContextManager[object]:
    return watching_connections(session, SessionConfig(), own=None, namespace="reenact")


asimo = cache(lambda: load_robot("asimo"))


def viewer(_session: Session) -> AbstractContextManager[object]:
    from pipeline.views.live import LiveView
    from pipeline.views.motion import answers_shown

    view = LiveView("nowhere")
    view.attempt(lambda: 1 / 0)  # nothing is sent from now on
    return answers_shown(view, asimo(), title="asimo serves")


@pytest.mark.parametrize(
    "block", [thread, stream, writer, node, connections, pytest.param(viewer, marks=pytest.mark.extra)]
)
def test_wherever_a_block_is_cut_short_its_thread_ends(block: Block, session: Session) -> None:
    assert cut_everywhere(lambda: block(session)) > 10
