"""Sessions: either end may start first, routers join clients, nothing listens unasked, errors are one clear line."""

import json
import os
import signal
import socket
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
from processes import zenoh_pools
from sockets import listening, loopback
from visitor import PATIENCE_S, await_ready, outcome, refusal, visitor
from waiting import wait_until

from recorders.errors import WireError
from recorders.wire.callbacks import on_network_thread
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import (
    LOSSY,
    SessionConfig,
    _unlinked,
    beyond_loopback,
    has_subscribers,
    open_session,
    publishing,
    single_network_thread,
)

SECRET = "sesame-open"


def setting(config: SessionConfig, name: str) -> Any:
    return json.loads(config.to_zenoh().get_json(name))


def write(folder: Path, text: str) -> Path:
    path = folder / "zenoh.json5"
    path.write_text(text)
    return path


def test_nobody_listening_is_one_clear_error() -> None:
    endpoint = free_endpoint()
    with pytest.raises(
        WireError,
        match=r"nothing listens at .* within 0\.3 s; start .*`reenact robot .* or `reenact learn .*--connect$",
    ) as e:
        open_session(SessionConfig(connect=(endpoint,), wait_s=0.3))
    assert endpoint in str(e.value)


def test_the_end_that_connects_may_start_first() -> None:
    endpoint = free_endpoint()
    with ExitStack() as stack:
        with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))) as nobody:
            early = stack.enter_context(visitor("idle", connect=[endpoint], seconds=0.1))
            nobody.accept()[0].close()  # it has tried
        with visitor("idle", listen=[endpoint]) as late:
            await_ready(late)
            assert outcome(early) == {}


def test_the_first_endpoint_that_answers_is_enough() -> None:
    endpoint = free_endpoint()
    with visitor("idle", listen=[endpoint]) as listener:
        await_ready(listener)
        with open_session(SessionConfig(connect=(free_endpoint(), endpoint), wait_s=PATIENCE_S)) as session:
            assert len(list(session.info.routers_zid())) == 1


@pytest.mark.parametrize("somebody_who_never_speaks", [False, True])
def test_an_interrupt_ends_the_waiting(somebody_who_never_speaks: bool) -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        if somebody_who_never_speaks:
            mute.listen()
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with visitor("idle", connect=[endpoint], wait_s=200.0) as process:
            wait_until(lambda: zenoh_pools(process.pid))
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=120)
    assert process.returncode == -signal.SIGINT, err
    assert err.endswith("KeyboardInterrupt\n")


def test_somebody_else_on_the_endpoint_is_named() -> None:
    endpoint = free_endpoint()
    with visitor("idle", listen=[endpoint]) as first:
        await_ready(first)
        with visitor("idle", listen=[endpoint]) as second:
            line = refusal(second)
    assert endpoint in line
    assert "something else listens there: give another endpoint with --listen" in line
    assert ".rs:" not in line


def test_clients_reach_one_another_through_a_router_and_again_after_it_was_killed() -> None:
    endpoint = free_endpoint()
    with (
        visitor("idle", listen=[endpoint]) as router,
        visitor("guest", connect=[endpoint]) as other,
        open_session(SessionConfig(connect=(endpoint,), wait_s=PATIENCE_S)) as session,
    ):
        await_ready(other)
        with session.declare_subscriber("reenact/hand/left/target") as subscriber:
            next_sample(subscriber)
            router.kill()
            router.wait()
            wait_until(lambda: not list(session.info.routers_zid()))
            while subscriber.try_recv() is not None:  # what was under way
                pass
            with visitor("idle", listen=[endpoint]) as again:
                await_ready(again)
                next_sample(subscriber)


def next_sample(subscriber: zenoh.Subscriber[Any]) -> zenoh.Sample:
    found: list[zenoh.Sample] = []

    def has_come() -> bool:
        if (sample := subscriber.try_recv()) is not None:
            found.append(sample)
        return bool(found)

    wait_until(has_come)
    return found[0]


def test_a_router_that_connects_joins_its_own_clients_to_the_other_router() -> None:
    near, far = free_endpoint(), free_endpoint()
    with (
        visitor("learn", connect=[far]) as learner,
        visitor("idle", listen=[far]) as other,
        visitor("idle", listen=[near], connect=[far]) as hub,
    ):
        for process in (other, hub, learner):
            await_ready(process)
        with visitor("replay", connect=[near]) as replay:
            assert outcome(replay) == outcome(learner)


def test_a_router_says_which_endpoint_it_could_not_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    there, nobody, mine = free_endpoint(), free_endpoint(), free_endpoint()
    monkeypatch.setattr("recorders.wire.session._unlinked", partial(unlinked_but, there))
    with visitor("idle", listen=[there]) as other:
        await_ready(other)
        with pytest.raises(WireError, match="nothing listens at") as raised:
            open_session(SessionConfig(connect=(there, nobody), listen=(mine,), wait_s=0.0))
    assert nobody in str(raised.value)
    assert there not in str(raised.value)
    with socket.create_server(("127.0.0.1", int(mine.rpartition(":")[2]))):
        pass  # nothing is left listening


def unlinked_but(there: str, session: zenoh.Session, connect: Sequence[str]) -> list[str]:
    """Return where a session is not linked, once it is linked to `there`, however long that takes."""
    wait_until(lambda: there not in _unlinked(session, connect))
    return _unlinked(session, connect)


def test_whoever_listens_does_so_on_loopback_alone_and_the_rest_nowhere() -> None:
    endpoint = free_endpoint()
    with visitor("idle", listen=[endpoint]) as listener, visitor("idle", connect=[endpoint]) as client:
        with visitor("idle") as alone:
            for process in (listener, client, alone):
                await_ready(process)
            assert listening(listener.pid) == {loopback(endpoint)}
            assert listening(client.pid) == set()
            assert listening(alone.pid) == set()


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/127.0.0.1", "tcp/", "carrier-pigeon/127.0.0.1:7447", ""])
def test_a_malformed_endpoint_is_quoted(endpoint: str) -> None:
    for config in (SessionConfig(connect=(endpoint,)), SessionConfig(listen=(endpoint,))):
        with pytest.raises(WireError, match="expected an endpoint such as") as raised:
            open_session(config)
        assert repr(endpoint) in str(raised.value)


def test_no_scouting_and_no_shared_memory() -> None:
    config = SessionConfig(listen=("tcp/127.0.0.1:7447",))
    for name in ("scouting/multicast/enabled", "scouting/gossip/enabled", "transport/shared_memory/enabled"):
        assert setting(config, name) is False


def test_the_file_wins_where_it_speaks_and_nowhere_else(tmp_path: Path) -> None:
    text = """{ mode: "peer", scouting: { gossip: { enabled: true } }, connect: { endpoints: ["tcp/127.0.0.1:1"] },
                transport: { unicast: { open_timeout: 1234 }, shared_memory: { enabled: true } } } // JSON5"""
    config = SessionConfig(config_file=write(tmp_path, text))
    assert config.resolved(listen=("tcp/127.0.0.1:2",)).connect == ("tcp/127.0.0.1:1",)
    assert config.resolved(listen=("tcp/127.0.0.1:2",)).listen == ()
    assert setting(config, "mode") == "client"
    assert setting(config, "scouting/gossip/enabled") is True
    assert setting(config, "scouting/multicast/enabled") is False
    assert setting(config, "transport/unicast/open_timeout") == 1234
    assert setting(config, "transport/shared_memory/enabled") is False


def test_endpoints_given_come_before_those_of_the_file_and_defaults_last(tmp_path: Path) -> None:
    named = write(
        tmp_path, '{ connect: { endpoints: ["tcp/127.0.0.1:1"] }, listen: { endpoints: ["tcp/127.0.0.1:2"] } }'
    )
    given = SessionConfig(listen=("tcp/127.0.0.1:3",), config_file=named)
    assert setting(given, "connect/endpoints") == []
    assert setting(given, "listen/endpoints") == ["tcp/127.0.0.1:3"]
    assert SessionConfig().resolved(connect=("tcp/127.0.0.1:4",)).connect == ("tcp/127.0.0.1:4",)
    silent = SessionConfig(config_file=write(tmp_path, "{}"))
    assert silent.resolved(listen=("tcp/127.0.0.1:5",)).listen == ("tcp/127.0.0.1:5",)
    assert setting(silent, "listen/endpoints") == []


def test_files_that_the_file_names_are_looked_up_beside_it(tmp_path: Path) -> None:
    (tmp_path / "users.txt").write_text("ann:secret\n")
    path = write(tmp_path, '{ transport: { auth: { usrpwd: { dictionary_file: "users.txt" } } } }')
    found = setting(SessionConfig(config_file=path), "transport/auth/usrpwd/dictionary_file")
    assert found == str(tmp_path / "users.txt")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1, column 1: expected array"),
        (f'{{ transport: {{ auth: {{ usrpwd: {{ user: "a", password: "{SECRET}" }} }}', "line 1, column"),
        ("{ modus: 1 }", "unknown field `modus`"),
        ('{ mode: "frog" }', "unknown variant `frog`"),
        ('{ transport: { auth: { usrpwd: { user: "ann" } } } }', "a user needs a password"),
        ('{ transport: { auth: { usrpwd: { dictionary_file: "none.txt" } } } }', "dictionary_file: there is no file"),
        (
            '{ transport: { link: { tls: { root_ca_certificate: "no.pem" } } } }',
            "root_ca_certificate: there is no file",
        ),
        ("{ transport: { auth: { usrpwd: { dictionary_file: 'bad.txt' } } } }", "Invalid user-password dictionary"),
        ('{ connect: { endpoints: ["frog"] } }', "<protocol>/<address>"),
        ('{ connect: { endpoints: { peer: ["tcp/127.0.0.1:1"] } } }', "connect/endpoints: expected a list"),
        ("{ access_control: { enabled: true } }", "All ACL rules/subjects/policies config lists must be provided"),
        ("[1]", "invalid type"),
        (b"\xff\xfe", "utf-8"),
    ],
)
def test_a_bad_file_is_named_with_its_problem(tmp_path: Path, text: str | bytes, says: str) -> None:
    (tmp_path / "bad.txt").write_text("neither user nor password\n")
    path = tmp_path / "zenoh.json5"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(WireError) as raised:
        with open_session(SessionConfig(config_file=path).resolved(listen=(free_endpoint(),))):
            pass
    line = str(raised.value)
    assert str(path) in line
    assert says in line
    assert "\n" not in line
    assert ".rs:" not in line
    assert SECRET not in line


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.json5", tmp_path):
        with pytest.raises(WireError, match="expected a Zenoh configuration file") as raised:
            open_session(SessionConfig(config_file=path))
        assert str(path) in str(raised.value)


def test_a_publisher_ends_cleanly_in_the_middle_of_a_put() -> None:
    begun, over = threading.Event(), threading.Event()
    with open_session(SessionConfig(listen=(free_endpoint(),))) as session, ThreadPoolExecutor() as pool:

        def put_on(publisher: zenoh.Publisher) -> None:
            with suppress(zenoh.ZError, RuntimeError):  # once it has ended, or while it ends
                while not over.wait(0.005):
                    publisher.put(payload)
                    begun.set()

        payload = bytes(4 << 20)  # takes milliseconds
        for _ in range(10):
            with publishing(session, "busy") as publisher:
                putting = pool.submit(put_on, publisher)
                assert begun.wait(120)
            over.set()
            putting.result(timeout=120)
            over.clear()
            begun.clear()


def test_who_listens_may_stall_while_thousands_of_outputs_come() -> None:
    endpoint, received, goes_on = f"{free_endpoint()}#so_sndbuf=4096;so_rcvbuf=4096", list[bytes](), threading.Event()

    def stalled(sample: zenoh.Sample) -> None:
        goes_on.wait()
        received.append(sample.payload.to_bytes())

    with ExitStack() as stack:
        listener = stack.enter_context(open_session(SessionConfig(listen=(endpoint,))))
        session = stack.enter_context(open_session(SessionConfig(connect=(endpoint,))))
        stack.enter_context(on_network_thread(partial(listener.declare_subscriber, "outputs"), stalled))
        stack.callback(goes_on.set)
        publisher = stack.enter_context(publishing(session, "outputs", **LOSSY))
        wait_until(lambda: has_subscribers(publisher))
        for number in range(2_000):
            publisher.put(number.to_bytes(2) + bytes(250))
        goes_on.set()
        wait_until(lambda: len(received) == 2_000)
    assert [int.from_bytes(each[:2]) for each in received] == list(range(2_000))


def test_a_client_may_read_what_comes_on_the_thread_that_notices_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    endpoint = free_endpoint()
    with visitor("idle", listen=[endpoint]) as router, visitor("idle", connect=[endpoint], as_it_comes=True) as client:
        await_ready(router)
        await_ready(client)
        wait_until(lambda: {"rx", "tx", "acc"} <= zenoh_pools(router.pid))
        wait_until(lambda: {"app", "tx"} <= zenoh_pools(client.pid))
        assert zenoh_pools(client.pid) == {"app", "tx"}


@pytest.mark.parametrize("before", [{}, {"ZENOH_RUNTIME": "(rx: (worker_threads: 1))"}])
def test_what_is_started_after_that_may_listen(before: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Other processes take over the environment, by which a router would read on one thread as well."""
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    for name, value in before.items():
        monkeypatch.setenv(name, value)
    with single_network_thread():
        assert "ZENOH_RUNTIME" in os.environ
    assert os.environ.get("ZENOH_RUNTIME") == before.get("ZENOH_RUNTIME")


def test_what_the_environment_says_of_threads_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", "(rx: (worker_threads: 1))")
    endpoint = free_endpoint()
    with visitor("idle", listen=[endpoint]) as router, visitor("idle", connect=[endpoint], as_it_comes=True) as client:
        await_ready(router)
        await_ready(client)
        wait_until(lambda: {"rx", "tx"} <= zenoh_pools(client.pid))


@pytest.mark.parametrize(
    ("endpoint", "is_exposed"),
    [
        ("tcp/127.0.0.1:7447", False),
        ("tls/127.0.0.2:7447", False),
        ("tcp/[::1]:7447", False),
        ("tcp/[::ffff:127.0.0.1]:7447", False),
        ("tcp/localhost:7447", False),
        ("unixsock-stream//tmp/reenact", False),
        ("tcp/0.0.0.0:7447", True),
        ("tcp/0:7447", True),
        ("udp/[::]:7447", True),
        ("quic/192.168.7.5:7447", True),
        ("tcp/[fe80::1]:7447", True),
        ("tcp/no-such-host.invalid:7447#iface=lo", True),
    ],
)
def test_what_others_may_reach_is_told_from_loopback(endpoint: str, is_exposed: bool) -> None:
    assert beyond_loopback(["tcp/127.0.0.1:1", endpoint]) == ([endpoint] if is_exposed else [])


def test_a_session_that_does_not_close_in_time_hides_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stuck:
        def close(self) -> None:
            raise zenoh.ZError("close operation timed out!")

    monkeypatch.setattr("recorders.wire.session._open", lambda *arguments: Stuck())
    with pytest.raises(WireError, match="why it ended"), open_session(SessionConfig(listen=(free_endpoint(),))):
        raise WireError("why it ended")
