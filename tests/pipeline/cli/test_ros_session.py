"""A session with a client of others: its targets, our commands, a learner, a recording, and the recording played to it.

The client is ROBOTIS', in a process of its own; learner, controller and recorder are processes of ours.
"""

import json
import signal
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest
import zenoh
from episodes import write_episode
from processes import start, wait_for_line
from ros_peer import RosPeer, ros_peer
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner
from waiting import wait_for_arrival, wait_until

from pipeline.cli.app import app
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_COMMANDS, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.nodes.search import find_nodes
from recorders.reading.reader import LogReader
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN, SEED, TICKS = 9, 5, 25
FROM_PEER = {LEFT_TARGET: PoseStamped.TYPE, RIGHT_TARGET: PoseStamped.TYPE, SAMPLE_JOINTS: JointState.TYPE}
TYPES = FROM_PEER | {JOINT_COMMANDS: JointState.TYPE}
NODES = {
    "learn": f"learns asimo from {LEFT_TARGET} ({PoseStamped.TYPE})",
    "serve": f"serves {JOINT_COMMANDS} ({JointState.TYPE}) in ROS domain {DOMAIN}",
    "record": f"records all topics of ROS domain {DOMAIN}",
}
"""Line of each node of ours by which it is ready."""


@pytest.fixture(scope="module")
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture(scope="module")
def router(endpoint: str) -> Iterator[zenoh.Session]:
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        yield session


@pytest.fixture(scope="module")
def peer(router: zenoh.Session, endpoint: str) -> Iterator[RosPeer]:
    with ros_peer(endpoint, domain=DOMAIN) as peer:
        yield peer


def run(*arguments: object) -> dict[str, Any]:
    """Run a verb in this process, and return what it prints."""
    ended = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert ended.exit_code == 0, ended.stderr
    return dict(json.loads(ended.stdout))


def nodes(stack: ExitStack, folder: Path, endpoint: str) -> dict[str, Popen[str]]:
    """Start our nodes, and wait until each is ready."""
    options = {
        "learn": ("--live", "--robot", "asimo", "--seed", SEED, "--ticks", TICKS, "--out", "live.npz", "--json"),
        "serve": ("c.npz", "--json"),
        "record": ("--bag", "bag", "--json"),
    }
    started = {}
    for verb, given in options.items():
        process = started[verb] = stack.enter_context(
            start(verb, *given, "--ros", DOMAIN, "--connect", endpoint, cwd=folder)
        )
        stack.callback(process.kill)
    for verb, line in NODES.items():
        wait_for_line(started[verb], line)
    return started


def stopped(process: Popen[str]) -> dict[str, Any]:
    process.send_signal(signal.SIGINT)
    printed, complaints = process.communicate(timeout=120)
    assert "Traceback" not in complaints
    return dict(json.loads(printed.splitlines()[-1]))


def commands(controller: Controller, sent: Sequence[RecordedMessage]) -> list[bytes]:
    """Return what a controller answers that is given the same targets by hand."""
    served = ServedController(controller, config=ServingConfig(), report=lambda line: None)
    answers = (served.take(record) for record in sent if record.topic in (LEFT_TARGET, RIGHT_TARGET))
    return [answer.data for answer in answers if answer is not None]


def test_a_session_with_a_client_of_others_is_one_state_and_goes_back_to_it(
    router: zenoh.Session, peer: RosPeer, endpoint: str, tmp_path: Path
) -> None:
    sent = list(LogReader(write_episode(tmp_path / "log.mcap", samples=TICKS - 1)))
    config = LearnerConfig(seed=2)
    controller = train([tmp_path / "log.mcap"], schedule=Schedule(epochs=1), config=config).controller()
    controller.save(tmp_path / "c.npz")
    for topic, kind in FROM_PEER.items():
        peer.ask("publisher", topic=topic, type_name=kind, name="tracker")
    peer.ask("subscribe", topic=JOINT_COMMANDS, type_name=JointState.TYPE, name="arm")

    with ExitStack() as stack:
        started = nodes(stack, tmp_path, endpoint)
        for name in ("learner", "recorder"):
            wait_for_arrival(router, name)
        wait_until(lambda: "controller" in [node.name for node in find_nodes(router, namespace="reenact")])
        listed = dict(peer.ask("topics"))
        status = run("status", "--ros", DOMAIN, "--connect", endpoint, "--wait", 60)
        for record in sent:
            peer.ask("publish_cdr", topic=record.topic, payload=record.data.hex())
        answered = peer.received(JOINT_COMMANDS, TICKS)
        learned, said = started["learn"].communicate(timeout=120)
        assert started["learn"].returncode == 0, said
        served = stopped(started["serve"])
        wait_for_arrival(router, "recorder")
        recorded = stopped(started["record"])

    assert {topic: listed[topic] for topic in TYPES} == {topic: [kind] for topic, kind in TYPES.items()}
    assert {"/tracker", "/arm", "/learner", "/controller", "/recorder"} <= set(status["nodes"])
    shown = {row["topic"]: row for row in status["topics"]}
    assert {topic: shown[topic]["types"] for topic in TYPES} == {topic: [kind] for topic, kind in TYPES.items()}
    assert shown[JOINT_COMMANDS]["publishers"] == ["/controller"]
    assert "/arm" in shown[JOINT_COMMANDS]["subscriptions"]

    expected = {topic: [record.data for record in sent if record.topic == topic] for topic in FROM_PEER}
    expected[JOINT_COMMANDS] = commands(controller, sent)
    assert answered == expected[JOINT_COMMANDS]
    assert (served["commands"], recorded["gaps"], recorded["refused"]) == (TICKS, {}, {})
    log = LogReader(next((tmp_path / "bag").glob("*.mcap")))
    for topic, data in expected.items():
        found = list(log.records(topics=(topic,)))
        assert [record.data for record in found] == data
        assert [record.sequence - found[0].sequence for record in found] == list(range(TICKS))
    with AnyReader([tmp_path / "bag"]) as reader:
        theirs = [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]
    assert {topic: [data for name, data in theirs if name == topic] for topic in TYPES} == expected

    out = ("--robot", "asimo", "--seed", SEED, "--out", tmp_path / "trained.npz")
    trained, live = run("train", tmp_path / "bag", "--as-live", *out), json.loads(learned)
    for key in ("digest", "stream_digest", "steps", "ticks", "train_cm"):
        assert trained[key] == live[key]
    assert (live["ticks"], live["gaps"], live["dropped"], live["refused"]) == (TICKS, 0, 0, {})

    for topic, kind in FROM_PEER.items():
        peer.ask("subscribe", topic=topic, type_name=kind, name="viewer")
    peer.settle()
    waits = [f"--wait-for={topic}=1" for topic in TYPES]
    run("replay", tmp_path / "bag", "--play", "--ros", DOMAIN, "--connect", endpoint, *waits, "--wait", 60)
    for topic, data in expected.items():
        before = answered if topic == JOINT_COMMANDS else []
        assert peer.received(topic, len(before) + TICKS) == before + data


@pytest.mark.parametrize(
    "how",
    [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.campaign)],  # after its lease: 60 s
)
def test_a_client_that_dies_or_falls_silent_is_no_longer_listed(
    router: zenoh.Session, endpoint: str, how: signal.Signals
) -> None:
    def listed() -> list[str]:
        nodes: list[str] = run("status", "--ros", DOMAIN, "--connect", endpoint, "--wait", 60)["nodes"]
        return nodes

    with RosKeys(DOMAIN, NodeName("stays")).joined(router), ros_peer(endpoint, domain=DOMAIN) as mortal:
        mortal.ask("publisher", topic="/mortal", type_name=JointState.TYPE, name="mortal")
        wait_until(lambda: {"/mortal", "/stays"} <= set(listed()))
        mortal.process.send_signal(how)
        wait_until(lambda: "/mortal" not in listed())
        assert "/stays" in listed()
