"""What runs is seen: `status`, metrics, and the lines of those that lose sight of a robot; nothing listens unasked."""

import json
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from episodes import write_episode
from processes import start, wait_for_line
from rich.console import Console
from sockets import listening, loopback

from pipeline.cli import app
from pipeline.cli.sessions import session_config
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.terminal.status_table import duration, status_table
from pipeline.training.trainer import train
from recorders.nodes.keys import node_key
from recorders.nodes.status import NodeSource, NodeStatus, declared_node
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule

KINDS = ["robot", "controller", "learner", "recorder", "replay"]
FIELDS = {"kind", "name", "state", "since_s", "counts", "rates_hz", "latency_us", "digests"}


class Lab:
    """A robot that listens, and all who connect to it, each in a process of its own; metrics of each on a port."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self.endpoint = free_endpoint()
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.ports: dict[str, int] = {}

    def start(self, kind: str, ready: str, *arguments: object) -> None:
        port = self.ports[kind] = int(free_endpoint().rpartition(":")[2])
        command = (*arguments, "--prometheus", port)
        process = self.processes[kind] = self._stack.enter_context(start(*command, cwd=self._folder))
        self._stack.callback(process.kill)
        wait_for_line(process, ready)

    def start_robot(self) -> None:
        self.start("robot", "waits for commands", "robot", "--listen", self.endpoint)

    def metrics(self, kind: str) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.ports[kind]}/metrics") as answer:
            return str(answer.read().decode())


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("lab")
    log = write_episode(folder / "log.mcap", samples=30)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=2)).controller().save(folder / "c.npz")
    with ExitStack() as stack:
        lab = Lab(folder, stack)
        lab.start_robot()
        there = ("--connect", lab.endpoint)
        lab.start("controller", "controller serves", "serve", "c.npz", *there)
        lab.start("recorder", "recorder records", "record", "--out", "session.mcap", *there)
        lab.start("learner", "learner waits", "learn", "--out", "learned.npz", *there)
        lab.start("replay", "nobody is awaited", "replay", log, "--play", "--rate", 1, "--loop", 0, *there)
        yield lab


def status(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        app.main(["status", *arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def nodes(lab: Lab, capsys: pytest.CaptureFixture[str], until: Callable[[list[dict[str, Any]]], bool]) -> list[Any]:
    """Ask until the nodes are as expected: messages are on their way."""
    found: list[Any] = []
    while not until(found):
        assert status("--json", "--connect", lab.endpoint, "--wait", "120") == 0
        (line,) = capsys.readouterr().out.splitlines()
        found = json.loads(line)["nodes"]
    return found


def all_busy(found: list[dict[str, Any]]) -> bool:
    by_kind = {node["kind"]: node for node in found}
    return list(by_kind) == KINDS and all(
        by_kind[kind]["rates_hz"][what] > 0.0
        for kind, what in (("controller", "commands"), ("recorder", "messages"), ("replay", "messages"))
    )


def test_every_node_is_there_with_what_it_counts(lab: Lab, capsys: pytest.CaptureFixture[str]) -> None:
    found = nodes(lab, capsys, all_busy)
    assert all(set(node) == FIELDS and node["since_s"] > 0.0 for node in found)
    robot, controller, learner, recorder, replay = found
    assert (robot["name"], robot["state"]) == ("asimo", "lockstep")
    assert (controller["state"], learner["state"], recorder["state"], replay["state"]) == (
        "serving",
        "waiting",
        "recording",
        "sending",
    )
    assert robot["digests"]["robot"] == controller["digests"]["robot"]
    assert 0.0 < controller["latency_us"]["p50"] <= controller["latency_us"]["max"]
    assert status("--connect", lab.endpoint, "--wait", "120") == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in rows if row[:1].strip()] == ["kind", *KINDS]


def test_metrics_are_the_figures_of_the_status_and_on_loopback_alone(
    lab: Lab, capsys: pytest.CaptureFixture[str]
) -> None:
    found = nodes(lab, capsys, lambda found: len(found) == len(KINDS))
    for node in found:
        text = lab.metrics(node["kind"])
        who = f'kind="{node["kind"]}",name="{node["name"]}"'
        assert f"reenact_since_seconds{{{who}}}" in text
        assert f'reenact_node_info{{{who},state="{node["state"]}"}} 1.0' in text
        counted = re.findall(rf'reenact_count_total\{{{who},what="([^"]+)"\}}', text)
        assert set(counted) == set(node["counts"])
        assert all(f'{{digest="{digest}",{who}' in text for digest in node["digests"].values())
    for kind, process in lab.processes.items():
        own = {loopback(f":{lab.ports[kind]}")} | ({loopback(lab.endpoint)} if kind == "robot" else set())
        assert listening(process.pid) == own


def test_a_watch_goes_on_until_ctrl_c_and_listens_nowhere(lab: Lab, tmp_path: Path) -> None:
    with start("status", "--watch", "--json", "--connect", lab.endpoint, cwd=tmp_path) as process:
        assert process.stdout is not None
        while not json.loads(process.stdout.readline())["nodes"]:  # it is not connected yet
            pass
        assert len(json.loads(process.stdout.readline())["nodes"]) == len(KINDS)
        assert listening(process.pid) == set()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (0, "")


def test_a_watch_that_nobody_reads_any_more_ends(lab: Lab, tmp_path: Path) -> None:
    with start("status", "--watch", "--json", "--connect", lab.endpoint, cwd=tmp_path) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        process.stdout.close()
        assert process.wait(timeout=120) == 0


def test_a_watch_begins_before_anybody_is_there(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with start("status", "--watch", "--json", "--connect", endpoint, cwd=tmp_path) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline()) == {"nodes": []}
        robot = NodeSource("robot", "r", state=lambda: "real time", counts=dict)
        with (
            open_session(SessionConfig(listen=(endpoint,))) as session,
            declared_node(session, robot, namespace="reenact"),
        ):
            while not (found := json.loads(process.stdout.readline())["nodes"]):
                pass
        assert [(node["kind"], node["name"]) for node in found] == [("robot", "r")]
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
    assert process.returncode == 0


def test_whoever_is_connected_says_that_the_robot_is_lost_and_back(
    lab: Lab, capsys: pytest.CaptureFixture[str]
) -> None:
    nodes(lab, capsys, all_busy)
    lab.processes["robot"].kill()
    others = [process for kind, process in lab.processes.items() if kind != "robot"]
    for process in others:
        wait_for_line(process, "lost ")
    lab.start_robot()
    for process in others:
        wait_for_line(process, "back robot asimo at 20")


@contextmanager
def empty() -> Iterator[str]:
    """A session that listens, and nobody in it."""
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        yield endpoint


def test_no_node_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    with empty() as endpoint:
        assert status("--connect", endpoint, "--wait", "120") == 1
        out, line = capsys.readouterr()
        assert (out, line) == ("", f"no node runs in namespace 'reenact' at {endpoint}\n")
        assert status("--connect", endpoint, "--wait", "120", "--json") == 1
        assert json.loads(capsys.readouterr().out) == {"nodes": []}
    assert status("--connect", endpoint, "--wait", "0") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"no node runs: nothing listens at {endpoint}")


def test_where_nobody_was_found_is_named_also_if_a_file_has_it_listen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint, file = free_endpoint(), tmp_path / "zenoh.json5"
    file.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    assert status("--zenoh-config", str(file)) == 1
    assert capsys.readouterr().err == f"no node runs in namespace 'reenact' at {endpoint}\n"


def test_what_strangers_say_is_spelt_out(capsys: pytest.CaptureFixture[str]) -> None:
    endpoint = free_endpoint()
    text = json.dumps(NodeStatus("robot", "evil", "\x1b[2J\r", 1.0, {"\x1b]0;x\a": 1}).to_dict())
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        key = node_key("reenact", "robot", "evil", "status")

        def answer(query: Any) -> None:
            with query:
                query.reply(key, text)

        with session.declare_queryable(key, answer):
            assert status("--connect", endpoint, "--wait", "120") == 0
            assert status("--connect", endpoint, "--wait", "120", "--json") == 0
    out = capsys.readouterr().out
    assert all(line.isprintable() for line in out.splitlines())
    assert "\\x1b[2J" in out


def test_the_table_takes_nodes_that_say_little() -> None:
    assert status_table([NodeStatus("robot", "r", "no answer")]).row_count == 1
    assert [duration(seconds) for seconds in (-1.0, 59.9, 61.0, 7260.0)] == ["0 s", "59 s", "1 min 1 s", "2 h 1 min"]


def test_the_table_of_a_deployment_fits_80_columns_with_no_word_broken() -> None:
    robot = NodeStatus(
        "robot", "asimo", "real time", 23.0, {"commands": 51, "messages": 5070, "slipped_ms": 1728},
        {"commands": 5.1, "messages": 244.7}, {}, {"robot": "5697253c861f6b20"},
    )  # fmt: skip
    controller = NodeStatus(
        "controller", "controller", "serving", 16.0, {"commands": 51}, {"commands": 5.0},
        {"p50": 207.0, "p99": 963.0}, {"controller": "c5975ca1a2b3c4d5"},
    )  # fmt: skip
    console = Console(width=80, file=StringIO())
    console.print(status_table([robot, controller]))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for text in (
        "controller  controller",
        "slipped_ms 1728",
        "messages 5070 (244.7 a second)",
        "p50 207 us",
        "16 s   commands 51 (5.0 a second)",
        "c5975ca1",
    ):
        assert text in shown


@pytest.mark.parametrize("verb", ["robot", "serve", "learn", "record", "replay"])
def test_a_port_that_is_taken_is_one_line_before_anything_is_begun(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = {
        "serve": ["absent.npz"],
        "learn": ["--out", "c.npz"],
        "record": ["--out", "s.mcap"],
        "replay": ["absent.mcap"],
    }
    with empty() as endpoint:
        port = endpoint.rpartition(":")[2]
        with pytest.raises(SystemExit) as ended:
            app.main([verb, *arguments.get(verb, []), "--connect", endpoint, "--prometheus", port])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (
        f"reenact: --prometheus: expected a free port of 127.0.0.1, found {port}: Address already in use; "
        "choose another"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_missing_extra_is_one_line_that_names_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(SystemExit) as ended:
        app.main(["robot", "--prometheus", "9000"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "install reenact-robot with its extra metrics, as `pip install '.[metrics]'` does in its source folder"
    )


@pytest.mark.parametrize("given", ["option", "file"])
def test_an_endpoint_beyond_loopback_is_warned_of_with_the_page_on_credentials(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoints = ["tcp/0.0.0.0:7447", "tcp/127.0.0.1:7448", "tcp/[::]:7449"]
    file = tmp_path / "zenoh.json5"
    file.write_text(json.dumps({"listen": {"endpoints": endpoints}}))
    for listens in (False, True):
        options = (endpoints, None, None) if given == "option" else (None, None, file)
        assert session_config(*options, listens=listens).listen == tuple(endpoints)
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("warning: listens beyond this machine at tcp/0.0.0.0:7447, tcp/[::]:7449: ")
        assert line.endswith("data/zenoh/README.md")
    session_config(None, None, None, listens=True)
    assert capsys.readouterr().err == ""
