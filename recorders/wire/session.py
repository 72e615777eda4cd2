"""Opens Zenoh sessions: loopback only, no scouting, nothing listening unless asked."""

import ipaddress
import json
import os
import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, Self, TypeAlias

import zenoh

from recorders.errors import UnreachedError, WireError
from recorders.files.descriptors import need_descriptors
from recorders.wire.callbacks import on_network_thread
from recorders.wire.zenoh_config import endpoints, explicit_setting, read_config, reason

Session: TypeAlias = zenoh.Session
Sample: TypeAlias = zenoh.Sample

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""The default endpoint: a consumer listens there and a sender connects to it."""

_RUNTIME = "ZENOH_RUNTIME"
_READING_AS_IT_COMES = "(rx: (handover: app), acc: (handover: app), net: (handover: app), app: (worker_threads: 2))"
_DESCRIPTORS = 48  # a session takes 10, each connection one more, and its log, its files and questions some others
_RETRY_S = 0.1
_CLOSING_TRIES = 50
_NOBODY = "Unable to connect"  # how Zenoh's error begins when no endpoint let a client in
_ENDPOINT = re.compile(r"(tcp|tls|udp|quic|ws)/(?P<host>[^\s/]+):(?P<port>\d+)([?#]\S*)?|unixsock-stream/\S+")

_DEFAULTS: dict[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # half a second, spent on nothing where nobody scouts
    # One attempt at a time; the waiting is ours, so that Ctrl-C ends it.
    "connect/timeout_ms": 0,
    "connect/exit_on_failure": True,
    "listen/timeout_ms": 0,
    "transport/unicast/open_timeout": 3_000,  # how long Ctrl-C may have to wait for an end that never answers
    # Room for some 1400 commands, and as much for all else, such as what a learner publishes: after a stall they come
    # faster than a busy machine may send them, and what finds no room is dropped. Zenoh has no more than 16.
    "transport/link/tx/queue/size/real_time": 16,
    "transport/link/tx/queue/size/data": 16,
    # After a cut: soon, and never more than a second apart.
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 1_000, "period_increase_factor": 2},
}


@dataclass(frozen=True)
class SessionConfig:
    """Endpoints that a session listens on and connects to, and its credentials.

    A session that listens is a router: those connected to it reach one another through it. One that only connects is
    a client of the first endpoint that lets it in, and reconnects for as long as it lives.

    Parameters
    ----------
    connect : tuple of str
        Endpoints to connect to, as `tcp/127.0.0.1:7447` or `tls/robot.local:7447`.
    listen : tuple of str
        Endpoints to listen on. Empty: nothing listens.
    config_file : Path, optional
        A Zenoh configuration (JSON5), for credentials, certificates and access control; files that it names are
        looked up beside it. Its endpoints count only if neither `connect` nor `listen` is given, its mode never.
        Scouting stays off unless it is set there, shared memory even if it is set.
    wait_s : float
        How long to wait for somebody to listen where this session connects [s]: either end may be started first.
    """

    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config_file: Path | None = None
    wait_s: float = 10.0

    def resolved(self, *, connect: tuple[str, ...] = (), listen: tuple[str, ...] = ()) -> Self:
        """Return the same with endpoints: its own, else those of the file, else the ones given here.

        Raises
        ------
        WireError
            If the file is not usable, or an endpoint is malformed.
        """
        found = self
        if self.config_file is not None and not (self.connect or self.listen):
            file = read_config(self.config_file)
            found = replace(
                self,
                connect=endpoints(file, "connect/endpoints", path=self.config_file),
                listen=endpoints(file, "listen/endpoints", path=self.config_file),
            )
        if not (found.connect or found.listen):
            found = replace(self, connect=connect, listen=listen)
        for endpoint in (*found.connect, *found.listen):
            if not _ENDPOINT.fullmatch(endpoint):
                source = "" if found.config_file is None else f"{found.config_file} or options: "
                raise WireError(f"{source}expected an endpoint such as {DEFAULT_ENDPOINT}, found {endpoint!r}")
        return found

    def to_zenoh(self) -> zenoh.Config:
        """Return the Zenoh configuration.

        Raises
        ------
        WireError
            If the file is not usable, or an endpoint is malformed.
        """
        resolved = self.resolved()
        config = zenoh.Config() if self.config_file is None else read_config(self.config_file)
        settings = {name: value for name, value in _DEFAULTS.items() if explicit_setting(config, name) is None}
        if resolved.listen:
            # A router would wait in `open` for whom it connects to, and let nobody in meanwhile.
            settings |= {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
        settings |= {
            "mode": "router" if resolved.listen else "client" if resolved.connect else "peer",
            "listen/endpoints": resolved.listen,
            "connect/endpoints": resolved.connect,
            # On by default for payloads from 3 KB, where it can drop queries without a word (zenoh#2628).
            "transport/shared_memory/enabled": False,
        }
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        return config


def beyond_loopback(listen: Sequence[str]) -> list[str]:
    """Return the endpoints that others than the processes of this machine may reach.

    A host name counts as loopback only if every address that it stands for is one.

    Parameters
    ----------
    listen : sequence of str
        Endpoints as a resolved `SessionConfig` has them.
    """
    return [endpoint for endpoint in listen if not _is_loopback(endpoint)]


def _is_loopback(endpoint: str) -> bool:
    found = _ENDPOINT.fullmatch(endpoint)
    if found is None or found["host"] is None:
        return endpoint.startswith("unixsock-stream/")
    try:
        addresses = socket.getaddrinfo(found["host"].strip("[]"), None)
    except (OSError, UnicodeError):
        return False
    return all(_is_loopback_address(str(address[0])) for *_, address in addresses)


def _is_loopback_address(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    mapped = parsed.ipv4_mapped if isinstance(parsed, ipaddress.IPv6Address) else None
    return (mapped or parsed).is_loopback


def endpoint_of(connect: Sequence[str], destination: str) -> str | None:
    """Return the endpoint, of those that a session connects to, at which one of its links ends; None if at none.

    By port: a link names the address that a host name stood for. Where several share one, the link's own is returned.
    """
    found = [endpoint for endpoint in connect if _port(endpoint) == _port(destination)]
    return found[0] if len(found) == 1 else destination if found else None


@contextmanager
def single_network_thread() -> Iterator[None]:
    """Have the thread that notices a message read it and call its handler, if the first session opens in the block.

    By default Zenoh notices it on one thread and wakes another to read it. Only where none of the process will listen:
    who listens passes messages on, and the thread that waits to send a large one on would be missing to notice that it
    can be sent. Zenoh reads `ZENOH_RUNTIME` once, when the first session opens; it stands if it is set. After the block
    it is not set any more: other processes that are started here may listen.
    """
    if _RUNTIME in os.environ:
        yield
        return
    os.environ[_RUNTIME] = _READING_AS_IT_COMES
    try:
        yield
    finally:
        os.environ.pop(_RUNTIME, None)


def open_session(
    config: SessionConfig, *, on_wait: Callable[[], None] = lambda: None
) -> AbstractContextManager[zenoh.Session]:
    """Open a session, and close it at the end of the `with` block; left open, its threads keep the interpreter alive.

    Parameters
    ----------
    config : SessionConfig
        Where it listens and connects.
    on_wait : callable
        Called once if nobody is there yet, and it waits.

    Raises
    ------
    WireError
        If the configuration is not usable, an endpoint to listen on is in use already, or nobody listens at the
        endpoints to connect to, or lets this session in, within `wait_s`.
    ConfigError
        If this process may not open as many files as a session takes.
    """
    need_descriptors(_DESCRIPTORS, purpose="Zenoh")
    return _closing(_open(config.resolved(), on_wait))


@contextmanager
def _closing(session: zenoh.Session) -> Iterator[zenoh.Session]:
    try:
        yield session
    finally:
        with suppress(zenoh.ZError):  # it may take too long: what the block ended with must be reported all the same
            _insist(session.close)


LOSSY: dict[str, Any] = {
    "congestion_control": zenoh.CongestionControl.DROP,
    "allowed_destination": zenoh.Locality.REMOTE,
}
"""Options of a publisher to other sessions whose samples are dropped where the network is blocked."""


@contextmanager
def publishing(session: zenoh.Session, key: str, **options: Any) -> Iterator[zenoh.Publisher]:
    """Yield a publisher that ends cleanly even while another thread is in the middle of a put.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    key : str
        Where to publish.
    options
        As `zenoh.Session.declare_publisher` takes them.
    """
    publisher = session.declare_publisher(key, **options)
    try:
        yield publisher
    finally:
        _insist(publisher.undeclare)


def has_subscribers(publisher: Any) -> bool:
    """Whether anybody subscribes to what a publisher puts."""
    status: Any = publisher.matching_status  # typed as a bool, which it is not
    return bool(status.matching)


@contextmanager
def watching_tokens(
    session: zenoh.Session, key: str, on_change: Callable[[str, bool], None], *, history: bool = False
) -> Iterator[None]:
    """Call back when somebody comes or goes that has a liveliness token, while the block runs.

    It is called before anything that arrives later is handed over: who is answered by another of the same name knows
    that the first has gone.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    key : str
        Key of the tokens; wildcards are expanded.
    on_change : callable
        Takes a token's key and whether it is there now, on the thread that reads; must return at once.
    history : bool
        Whether those count as coming that are there already.
    """

    def on_token(sample: zenoh.Sample) -> None:
        on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    liveliness = session.liveliness()
    with on_network_thread(lambda call: liveliness.declare_subscriber(key, call, history=history), on_token):
        yield


def _insist(end: Callable[[], Any]) -> None:
    """End something of Zenoh's, once none of its threads holds it: until then it counts as borrowed."""
    for _ in range(_CLOSING_TRIES):
        try:
            end()
        except RuntimeError:
            time.sleep(_RETRY_S)
        else:
            return


def _open(config: SessionConfig, on_wait: Callable[[], None]) -> zenoh.Session:
    settings = config.to_zenoh()
    deadline = time.monotonic() + config.wait_s
    for attempt in count():
        try:
            session = zenoh.open(settings)
        except zenoh.ZError as error:
            if not str(error).startswith(_NOBODY):
                raise WireError(_failure(config, error)) from error
        else:
            if config.listen and config.connect:
                _await_links(session, config, deadline)
            return session
        if time.monotonic() >= deadline:
            break
        if attempt == 0:
            on_wait()
        time.sleep(_RETRY_S)
    raise _unreached(config.connect, config)


def _await_links(session: zenoh.Session, config: SessionConfig, deadline: float) -> None:
    """Wait until a router is connected wherever it should be; otherwise close it and name where it is not."""
    try:
        while missing := _unlinked(session, config.connect):
            if time.monotonic() >= deadline:
                raise _unreached(missing, config)
            time.sleep(_RETRY_S)
    except BaseException:
        _insist(session.close)
        raise


def _unlinked(session: zenoh.Session, connect: Sequence[str]) -> list[str]:
    # By port alone: a link names the address that a host name stood for.
    linked = {_port(str(link.dst)) for link in session.info.links()}
    return [endpoint for endpoint in connect if _port(endpoint) not in linked]


def _port(endpoint: str) -> str:
    found = _ENDPOINT.fullmatch(endpoint)
    return (found and found["port"]) or endpoint


def _failure(config: SessionConfig, error: Exception) -> str:
    where = ", ".join(config.listen or config.connect) or "any endpoint"
    file = "" if config.config_file is None else f" with {config.config_file}"
    text = reason(error)
    hint = "; something else listens there: give another endpoint with --listen" if "in use" in text else ""
    return f"no session on {where}{file}: {text}{hint}"


def _unreached(connect: Sequence[str], config: SessionConfig) -> WireError:
    for endpoint in connect:
        if _answers(endpoint):
            return WireError(
                f"{endpoint} is there, but let no session in within {config.wait_s:g} s; "
                "expected Zenoh over this protocol, and the user, password or certificates that it asks for"
            )
    router = "; with --ros the router, as by `ros2 run rmw_zenoh_cpp rmw_zenohd`" if DEFAULT_ENDPOINT in connect else ""
    return UnreachedError(
        f"nothing listens at {', '.join(connect)} within {config.wait_s:g} s; "
        f"start the other end there, such as `reenact robot --listen {connect[0]}` or "
        f"`reenact learn --listen {connect[0]}`{router}, or give another --connect"
    )


def _answers(endpoint: str) -> bool:
    """Return whether anything at all accepts connections there; Zenoh reports nobody and a refusal alike."""
    found = _ENDPOINT.fullmatch(endpoint)
    if found is None or found["host"] is None or found[1] in ("udp", "quic"):
        return False
    try:
        socket.create_connection((found["host"].strip("[]"), int(found["port"])), timeout=1.0).close()
    except (OSError, OverflowError):
        return False
    return True
