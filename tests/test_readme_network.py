"""What the guides and `data/zenoh` say of the network is so: commands, picture, what becomes of ROS 2 messages."""

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import typer.main
import zenoh
from episodes import write_episode
from here import reenact_here
from processes import reenact, start, wait_for_line
from short_motion import write_short_motion
from waiting import wait_for_arrival, wait_for_subscriber

import pipeline
from pipeline.cli import app as cli
from pipeline.cli.ros_domain import with_domain
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.topics import LEARNER_DIGEST, LEARNER_ERROR, LEARNER_OUTPUT, LEARNER_STATUS, LEARNER_TOPICS
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import DEFAULT_ENDPOINT, SessionConfig, open_session

ROOT = Path(pipeline.__file__).parent.parent
GUIDES = ROOT / "data" / "guides"
PAGES = [
    GUIDES / "first_log_to_controller.md",
    ROOT / "data" / "zenoh" / "README.md",
    ROOT / "data" / "zenoh" / "ros2.md",
]
PICTURE = ROOT / "data" / "pictures" / "topology.png"
LIVE = "## Live, in three terminals"
NO_DEFAULT_ENDPOINT = {"robot": "--listen", "record": "--connect"}  # what the example leaves to the default


def commands(text: str) -> list[list[str]]:
    """The arguments of every `reenact` in the indented blocks of a page, in order."""
    lines = re.findall(r"^    (?:\.venv/bin/)?reenact (.*)$", text, re.MULTILINE)
    return [[word for word in shlex.split(line, comments=True) if word != "&"] for line in lines]


@pytest.mark.parametrize(
    "page",
    [*PAGES, GUIDES / "golden_logs_in_ci.md", GUIDES / "ros2.md"],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_every_command_has_the_options_it_names(page: Path) -> None:
    verbs: Any = typer.main.get_command(cli.app)
    found = commands(page.read_text())
    assert found
    for verb, *arguments in found:
        verbs.commands[verb].make_context(verb, with_domain(arguments))


def test_every_page_and_picture_of_the_network_is_linked() -> None:
    guide, readme = PAGES[0].read_text(), (ROOT / "README.md").read_text()
    unlinked = [
        page for page in (*PAGES[1:], PICTURE) if f"(../{page.relative_to(ROOT / 'data').as_posix()})" not in guide
    ]
    assert unlinked == []
    assert [page for page in PAGES if f"({page.relative_to(ROOT).as_posix()})" not in readme] == []


def test_the_bridges_configuration_is_one_that_listens_nowhere() -> None:
    (text,) = re.findall(r"```json5\n(.*?)```", PAGES[2].read_text(), re.DOTALL)
    config = zenoh.Config.from_json5(text)
    assert json.loads(config.get_json("mode")) == "client"
    assert json.loads(config.get_json("connect/endpoints")) == [DEFAULT_ENDPOINT]
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False


def test_the_picture_is_what_its_script_draws(tmp_path: Path) -> None:
    drawn = tmp_path / "topology.png"
    subprocess.run([sys.executable, PICTURE.with_suffix(".py"), drawn], check=True, cwd=tmp_path, timeout=60)
    there, here = (matplotlib.image.imread(path) for path in (PICTURE, drawn))
    assert there.shape == here.shape
    assert np.abs(there - here).mean() < 1e-3
    assert PICTURE.stat().st_size < 150_000


def test_the_live_example_ends_in_one_state(tmp_path: Path) -> None:
    """As it stands there, on a port of its own and with a shorter motion."""
    section = PAGES[0].read_text().partition(LIVE)[2].partition("\n## ")[0]
    (tmp_path / "out").mkdir()  # as `make demo` does
    endpoint, motion = free_endpoint(), write_short_motion(tmp_path / "short.csv")
    replaced = {DEFAULT_ENDPOINT: endpoint, "eight": str(motion)}
    lines = [[replaced.get(word, word) for word in line] for line in commands(section)]
    lines = [
        [*line, NO_DEFAULT_ENDPOINT[line[0]], endpoint] if line[0] in NO_DEFAULT_ENDPOINT else line for line in lines
    ]
    assert [verb for verb, *_ in lines] == ["robot", "record", "learn", "explore", "train", "diff"]
    with ExitStack() as stack:
        nodes = []
        for line, ready in zip(lines, ("waits for commands", "records reenact/**", "waits for a replay"), strict=False):
            nodes.append(stack.enter_context(start(*line, cwd=tmp_path)))
            stack.callback(nodes[-1].kill)
            wait_for_line(nodes[-1], ready)
        explored = reenact(*lines[3], cwd=tmp_path)
        assert explored.returncode == 0, explored.stderr
        _, learned = (node.communicate(timeout=120)[0] for node in nodes[1:])
    trained, compared = (reenact_here(*line, cwd=tmp_path) for line in lines[4:])
    digest = re.compile(r"^digest +([0-9a-f]{64})$", re.MULTILINE)
    assert digest.findall(learned) == digest.findall(trained.stdout) != []
    assert (compared.returncode, compared.stdout) == (0, "no divergence\n")


def test_the_spectators_example_records_what_the_learner_says_and_nothing_else(tmp_path: Path) -> None:
    """As it stands there, on a port of its own and with a shorter log."""
    endpoint, log = free_endpoint(), tmp_path / "out" / "demo" / "circles.mcap"
    log.parent.mkdir(parents=True)
    write_episode(log)
    shutil.copytree(ROOT / "data" / "zenoh", tmp_path / "data" / "zenoh")
    section = PAGES[1].read_text().partition("\nAccess control, ")[2].partition("\nKeys ")[0]
    lines = [[endpoint if word == DEFAULT_ENDPOINT else word for word in line] for line in commands(section)]
    assert [verb for verb, *_ in lines] == ["learn", "record", "replay"]
    with ExitStack() as stack:
        nodes = []
        for line, ready in zip(lines, ("waits for a replay", "records reenact/**"), strict=False):
            nodes.append(stack.enter_context(start(*line, cwd=tmp_path)))
            stack.callback(nodes[-1].kill)
            wait_for_line(nodes[-1], ready)
        learner, spectator = nodes
        replayed = reenact(*lines[2], "--epochs", 20, cwd=tmp_path)
        assert replayed.returncode == 0, replayed.stderr
        learner.communicate(timeout=120)
        spectator.send_signal(signal.SIGINT)
        _, complaints = spectator.communicate(timeout=120)
    assert spectator.returncode == 0, complaints
    recorded = LogReader(tmp_path / "learner.mcap").counts
    assert set(recorded) == {LEARNER_OUTPUT, LEARNER_DIGEST, LEARNER_STATUS, LEARNER_ERROR}


def test_messages_as_a_bridge_sends_them_are_recorded_and_train(tmp_path: Path) -> None:
    """CDR bytes on the topics' keys, no attachment, no encoding, strings padded: no bridge, but what one sends."""
    episode = list(LogReader(write_episode(tmp_path / "episode.mcap")))
    padded = b"\x00\x01\x00\x03\x06\x00\x00\x00<xml>\x00\x00\x00\x00"
    endpoint = free_endpoint()
    with ExitStack() as stack:
        session = stack.enter_context(open_session(SessionConfig(listen=(endpoint,))))
        process = stack.enter_context(
            start("record", "--out", "ros.mcap", "--connect", endpoint, "--json", cwd=tmp_path)
        )
        stack.callback(process.kill)
        wait_for_line(process, "records reenact/**")
        wait_for_subscriber(session)
        for record in episode:
            put(session, record.topic, record.data)
        put(session, "/robot_description", padded)
        put(session, "/rosout", b"\x00\x01\x00\x00")
        wait_for_arrival(session, "recorder")
        process.send_signal(signal.SIGINT)
        result = json.loads(process.communicate(timeout=120)[0])
    assert result["opaque"] == {"/rosout": 1}
    recorded = {record.topic: record.type for record in LogReader(tmp_path / "ros.mcap")}
    types = {topic.name: topic.type for topic in LEARNER_TOPICS}
    assert recorded == types | {"/robot_description": String.TYPE, "/rosout": ""}
    assert set(types.values()) == {PoseStamped.TYPE, JointState.TYPE}
    train = ("train", "--epochs", 1, "--json")
    ours = reenact_here(*train, "episode.mcap", "--out", "ours.npz", cwd=tmp_path)
    theirs = reenact_here(*train, "ros.mcap", "--robot", "asimo", "--out", "theirs.npz", cwd=tmp_path)
    assert json.loads(theirs.stdout)["digest"] == json.loads(ours.stdout)["digest"]
    unnamed = reenact_here(*train, "ros.mcap", "--out", "unnamed.npz", cwd=tmp_path)
    assert unnamed.returncode == 2
    assert "--robot" in unnamed.stderr


def put(session: zenoh.Session, topic: str, payload: bytes) -> None:
    key = message_key("reenact", topic)
    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
