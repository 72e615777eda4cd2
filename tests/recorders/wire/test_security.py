"""The examples in data/zenoh, as they are: who has no credentials can neither feed the learner nor read commands."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from certificates import write_certificates
from collector import Collector
from visitor import TRIED, await_ready, await_words, outcome, refusal, stream_from, visitor

from recorders.nodes.search import find_nodes
from recorders.nodes.status import NodeSource, declared_node
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

EXAMPLES = Path(__file__).parents[3] / "data" / "zenoh"

KINDS = {
    "usrpwd": ("usrpwd-listen.json5", "usrpwd-connect.json5"),
    "tls": ("tls-listen.json5", "tls-connect.json5"),
    "mtls": ("mtls-listen.json5", "mtls-connect.json5"),
    "access": ("access-listen.json5", "usrpwd-connect.json5"),
}
COMMANDS, ERRORS = "reenact/joint_commands", "reenact/learner/error"


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The examples, with certificates beside them."""
    folder = tmp_path_factory.mktemp("keys") / "zenoh"
    shutil.copytree(EXAMPLES, folder)
    write_certificates(folder)
    with (folder / "users.txt").open("a") as users:
        users.write("newcomer:change-me-4\n")  # may connect; no policy names it
    return folder


def endpoint_for(kind: str) -> str:
    return free_endpoint().replace("tcp", "tls" if "tls" in kind else "tcp")


def user(keys: Path, name: str, password: str) -> Path:
    text = f'{{ transport: {{ auth: {{ usrpwd: {{ user: "{name}", password: "{password}" }} }} }} }}'
    return write(keys / f"{name}-{password}.json5", text)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@contextmanager
def learner(keys: Path, kind: str) -> Iterator[tuple[str, Any]]:
    endpoint = endpoint_for(kind)
    with visitor("learn", listen=[endpoint], config_file=keys / KINDS[kind][0]) as process:
        await_ready(process)
        yield endpoint, process


def feed(keys: Path, kind: str, endpoint: str, process: Any) -> None:
    """Feed the learner as the example says, and check that it took exactly that."""
    with visitor("replay", connect=[endpoint], config_file=keys / KINDS[kind][1]) as replay:
        assert outcome(replay) == outcome(process) == Collector().consume(stream_from(0))


@pytest.mark.parametrize("kind", KINDS)
def test_with_the_example_a_replay_feeds_the_learner(keys: Path, kind: str) -> None:
    with learner(keys, kind) as (endpoint, process):
        feed(keys, kind, endpoint, process)


def strangers(keys: Path, kind: str) -> dict[str, Path | None]:
    """The configurations with which nobody must be let in."""
    if kind in ("usrpwd", "access"):
        return {
            "no user": None,
            "unknown user": user(keys, "mallory", "change-me-1"),
            "wrong password": user(keys, "replay", "sesame"),
        }
    found: dict[str, Path | None] = {
        "no certificates at all": None,
        "another authority": tls(keys / "other.json5", root_ca_certificate="stranger-ca.pem"),
    }
    if kind == "mtls":
        mine = {"connect_private_key": "stranger.key", "connect_certificate": "stranger.pem"}
        found["nothing to show"] = tls(keys / "bare.json5", root_ca_certificate="ca.pem")
        found["a stranger's certificate"] = tls(
            keys / "stranger.json5", root_ca_certificate="ca.pem", enable_mtls=True, **mine
        )
    return found


def tls(path: Path, **settings: str | bool) -> Path:
    return write(path, json.dumps({"transport": {"link": {"tls": settings}}}))


@pytest.mark.parametrize("kind", KINDS)
def test_a_stranger_is_not_let_in_and_told_so_in_one_line(keys: Path, kind: str) -> None:
    with learner(keys, kind) as (endpoint, process):
        for what, file in strangers(keys, kind).items():
            options = {} if file is None else {"config_file": file}
            with visitor("replay", connect=[endpoint], wait_s=0.5, **options) as stranger:
                line = refusal(stranger)
            assert f"{endpoint} is there, but let no session in within 0.5 s" in line, what
            assert "change-me" not in line, what
            assert "sesame" not in line, what
        feed(keys, kind, endpoint, process)


@pytest.mark.parametrize("kind", ["tls", "mtls"])
def test_plain_tcp_reaches_nobody_who_asked_for_tls(keys: Path, kind: str) -> None:
    with learner(keys, kind) as (endpoint, process):
        plain = endpoint.replace("tls/", "tcp/")
        with visitor("replay", connect=[plain], wait_s=0.5) as stranger:
            assert f"{plain} is there, but let no session in" in refusal(stranger)
        feed(keys, kind, endpoint, process)


INPUTS = {COMMANDS, "reenact/hand/left/target", "reenact/replay/batch", "reenact/@consumer/learner/ack"}
ALL_OF_THE_GUEST = INPUTS | {"asked", "answered"}
ALL_OF_THE_HOST = {COMMANDS, ERRORS, "asked", "answered"}
NOTHING: set[str] = set()


def assert_received(
    listen: Path, connect: Path, endpoint: str, *, of_the_guest: set[str], of_the_host: set[str]
) -> None:
    """Let a guest try everything; the host receives this of it, and it this of the host, and no more."""
    with (
        visitor("host", listen=[endpoint], config_file=listen) as host,
        visitor("guest", connect=[endpoint], config_file=connect) as guest,
    ):
        await_words(guest, of_the_host | {TRIED})
        await_words(host, of_the_guest | {TRIED})
        for process in (guest, host):
            process.terminate()
        assert (set(outcome(host)["heard"]), set(outcome(guest)["heard"])) == (of_the_guest, of_the_host)


def test_whom_access_control_admits_can_do_everything(keys: Path) -> None:
    listen, connect = keys / "access-listen.json5", keys / "usrpwd-connect.json5"
    assert_received(listen, connect, free_endpoint(), of_the_guest=ALL_OF_THE_GUEST, of_the_host=ALL_OF_THE_HOST)


def test_a_spectator_hears_the_learner_alone_and_sends_nothing(keys: Path) -> None:
    listen, connect = keys / "access-listen.json5", keys / "spectator-connect.json5"
    assert_received(listen, connect, free_endpoint(), of_the_guest=NOTHING, of_the_host={ERRORS})


def test_whom_no_policy_names_hears_nothing_and_sends_nothing(keys: Path) -> None:
    listen, connect = keys / "access-listen.json5", user(keys, "newcomer", "change-me-4")
    assert_received(listen, connect, free_endpoint(), of_the_guest=NOTHING, of_the_host=NOTHING)


@pytest.mark.parametrize(("admitted", "expected"), [("replay", ALL_OF_THE_HOST), ("somebody-else", NOTHING)])
def test_access_control_by_the_name_in_a_certificate(keys: Path, admitted: str, expected: set[str]) -> None:
    """As data/zenoh/README.md says: access_control of one example, transport of the other."""
    access = (keys / "access-listen.json5").read_text()
    control = access[access.index("access_control:") : access.rindex("}")]
    control = control.replace('usernames: ["replay", "robot"]', f'cert_common_names: ["{admitted}"]')
    transport = (keys / "mtls-listen.json5").read_text()
    both = transport[: transport.rindex("}")] + control + "}"
    listen = write(keys / f"both-{admitted}.json5", both)
    assert_received(
        listen,
        keys / "mtls-connect.json5",
        endpoint_for("mtls"),
        of_the_guest=ALL_OF_THE_GUEST if expected else NOTHING,
        of_the_host=expected,
    )


@pytest.mark.parametrize("name", ["spectator", "newcomer"])
def test_who_may_not_feed_the_learner_finds_none(keys: Path, name: str) -> None:
    listed = keys / "spectator-connect.json5" if name == "spectator" else user(keys, name, "change-me-4")
    with learner(keys, "access") as (endpoint, process):
        with visitor("replay", connect=[endpoint], config_file=listed, seconds=1.0) as replay:
            assert "no consumer named 'learner' answered" in refusal(replay)
        feed(keys, "access", endpoint, process)


def test_operators_see_one_anothers_nodes_and_a_spectator_none(keys: Path) -> None:
    endpoint = free_endpoint()
    source = NodeSource("recorder", "anna", state=lambda: "recording", counts=dict)
    listen = SessionConfig(listen=(endpoint,), config_file=keys / "access-listen.json5")
    with open_session(listen) as near, declared_node(near, source, namespace="reenact"):
        for name, seen in (("usrpwd", ["anna"]), ("spectator", [])):
            connect = SessionConfig(connect=(endpoint,), config_file=keys / f"{name}-connect.json5")
            with open_session(connect) as far:
                assert [node.name for node in find_nodes(far, namespace="reenact", timeout_s=120.0)] == seen
