"""A controller that goes by `/clock`: nothing arrives before there is a time, and the log has that time."""

from pathlib import Path

import pytest
import zenoh
from episodes import write_episode
from waiting import wait_until

from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.serving.background_writer import BackgroundWriter
from pipeline.serving.node import Node
from pipeline.serving.node_config import ServeConfig
from pipeline.training.trainer import train
from recorders.cdr.codec import encode
from recorders.messages.message_types import Clock
from recorders.messages.topics import CLOCK, LEFT_TARGET, RIGHT_TARGET
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("serve") / "log.mcap", samples=6)


@pytest.fixture(scope="module")
def controller(log: Path) -> Controller:
    return train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=2)).controller()


def put(session: zenoh.Session, topic: str, data: bytes) -> None:
    session.put(message_key("reenact", topic), data)


def test_the_log_has_the_time_of_the_clock(log: Path, controller: Controller, tmp_path: Path) -> None:
    targets = [record for record in LogReader(log) if record.topic in (LEFT_TARGET, RIGHT_TARGET)]
    endpoint, config = free_endpoint(), ServeConfig(record=tmp_path / "served.mcap", use_sim_time=True)
    writer = BackgroundWriter(config.log(controller))
    node = Node(controller, config, writer)
    with (
        writer.running(),
        open_session(SessionConfig(listen=(endpoint,))) as session,
        node.declared(session, where="here"),
        open_session(SessionConfig(connect=(endpoint,))) as other,
    ):
        put(other, targets[0].topic, targets[0].data)
        wait_until(lambda: node.status()["refused"] == {"no time": 1})
        assert node.status()["last_refusal"] == f"{targets[0].topic}: before the first message of /clock"
        put(other, CLOCK, b"noon")
        put(other, CLOCK, bytes(1000))
        put(other, CLOCK, encode(Clock(77)))
        for record in targets[2:4]:
            put(other, record.topic, record.data)
        wait_until(lambda: node.status()["accepted"] == 1)
    found = list(LogReader(tmp_path / "served.mcap"))
    assert {record.topic for record in found} > {LEFT_TARGET, RIGHT_TARGET}
    assert {record.log_time_ns for record in found} == {77}
