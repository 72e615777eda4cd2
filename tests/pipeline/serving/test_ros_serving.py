"""`serve --ros`: a client of others gives PoseStamped targets and gets the commands of each type, to the bit."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import zenoh
from episodes import write_episode
from ros_peer import RosPeer, ros_peer

from pipeline.alignment.config import AlignmentConfig
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.serving.background_writer import BackgroundWriter
from pipeline.serving.config import ServingConfig
from pipeline.serving.node import Node
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.output.command_types import CommandFormat, CommandType
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train
from recorders.cdr.codec import encode
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import PoseStamped, TFMessage, TransformStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, TF_STATIC
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.live import live_offer
from replay.sources.schedule import Schedule
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 11
TICKS = 3
PERIOD_NS = 100_000_000
HANDS = {LEFT_TARGET: np.array([0.3, 0.2, 0.7]), RIGHT_TARGET: np.array([0.3, -0.2, 0.7])}
LIFT = np.array([0.0, 0.0, 0.125])  # which is subtracted and added without a rest

Ends = tuple[zenoh.Session, RosPeer]


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Controller:
    log = write_episode(tmp_path_factory.mktemp("ros") / "log.mcap", samples=8)
    return train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=2)).controller()


@pytest.fixture(scope="module")
def ends() -> Iterator[Ends]:
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))) as session, ros_peer(endpoint, domain=DOMAIN) as peer:
        for topic in HANDS:
            peer.ask("publisher", topic=topic, type_name=PoseStamped.TYPE, name="tracker")
        peer.ask("publisher", topic=TF_STATIC, type_name=TFMessage.TYPE, name="tracker")
        yield session, peer


@contextmanager
def serving(session: zenoh.Session, controller: Controller, config: ServeConfig) -> Iterator[Node]:
    with BackgroundWriter(None).running() as writer:
        node = Node(controller, config, writer)
        with config.keys.joined(session), node.declared(session, where="here"):
            yield node


def keys(command: CommandFormat) -> RosKeys:
    return RosKeys(DOMAIN, NodeName.remapped("serve", "/", [f"{command.topic}:=/robot{command.topic}"]))


def poses(frame: str = "") -> list[tuple[str, PoseStamped]]:
    shift = LIFT if frame else 0.0
    return [
        (topic, PoseStamped((index + 1) * PERIOD_NS, hand - shift, frame_id=frame or "world"))
        for index in range(TICKS)
        for topic, hand in HANDS.items()
    ]


def expected(controller: Controller, command: CommandFormat) -> list[bytes]:
    """The commands of a controller that is given the same targets by hand."""
    served = ServedController(controller, config=ServingConfig(commands=command), report=lambda line: None)
    answers = []
    for number, (topic, pose) in enumerate(poses()):
        answer = served.take(RecordedMessage(topic, PoseStamped.TYPE, encode(pose), number // 2, 0))
        answers += [] if answer is None else [answer.data]
    return answers


@pytest.mark.parametrize("kind", list(CommandType))
def test_targets_of_a_client_of_others_are_answered_in_its_type(
    ends: Ends, controller: Controller, kind: CommandType
) -> None:
    session, peer = ends
    command = CommandFormat(kind)
    config, topic = ServeConfig(keys=keys(command), serving=ServingConfig(commands=command)), f"/robot{command.topic}"
    with serving(session, controller, config):
        peer.ask("subscribe", topic=topic, type_name=command.type_name, name="robot")
        peer.settle()
        for each, pose in poses():
            peer.publish(each, pose)
        assert peer.received(topic, TICKS) == expected(controller, command)


def test_targets_in_a_frame_of_tf_static_are_turned_into_the_robots(ends: Ends, controller: Controller) -> None:
    session, peer = ends
    command = CommandFormat(topic="/aligned")
    alignment = AlignmentConfig(ticks_of=LEFT_TARGET)
    config = ServeConfig(keys=keys(command), serving=ServingConfig(commands=command), alignment=alignment)
    topic = f"/robot{command.topic}"
    table = TransformStamped(1, "world", "table", LIFT, np.array([0.0, 0.0, 0.0, 1.0]))
    with serving(session, controller, config):
        peer.ask("subscribe", topic=topic, type_name=command.type_name, name="robot")
        peer.settle()
        peer.publish(TF_STATIC, TFMessage((table,)))
        for each, pose in poses("table"):
            peer.publish(each, pose)
        found = peer.received(topic, TICKS - 1)  # the last tick waits for what comes after it
    assert found == expected(controller, CommandFormat())[: len(found)]


def test_a_replay_awaits_a_controller_whose_targets_have_names_of_others(
    controller: Controller,
) -> None:
    endpoint, names = free_endpoint(), {"/goal": LEFT_TARGET, "/aim": RIGHT_TARGET}
    alignment = AlignmentConfig(ticks_of=LEFT_TARGET)
    ours = RosKeys(DOMAIN, NodeName("serve"))
    config = ServeConfig(keys=ours, serving=ServingConfig(), alignment=alignment, renames=names)
    pose = PoseStamped(PERIOD_NS, HANDS[LEFT_TARGET], frame_id="world")
    message = RecordedMessage("/goal", PoseStamped.TYPE, encode(pose), 0, 0)
    channel = DeclaredChannel("/goal", "cdr", schema=(PoseStamped.TYPE, "ros2msg", b""))
    sending = SenderConfig(("controller",), keys=RosKeys(DOMAIN, NodeName("replay")), batch_size=1, wait_s=60.0)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as other,
        serving(session, controller, config),
    ):
        transport = ZenohTransport(other, config=sending, channels=[channel])
        result = transport.deliver(live_offer("0" * 32, epochs=1, robot={}), lambda start: iter([message][start:]))
    assert set(result["controller"]["topics"]) >= set(names)
