"""Opens Zenoh sessions: loopback only, no scouting, nothing listening unless asked."""

import json
from dataclasses import dataclass

import zenoh

from recorders.errors import WireError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a consumer listens and a sender connects when neither is told otherwise."""


@dataclass(frozen=True)
class SessionConfig:
    """Where a session listens and what it connects to.

    Parameters
    ----------
    connect : tuple of str
        Endpoints to connect to, as `tcp/127.0.0.1:7447`; retried for as long as the session lives.
    listen : tuple of str
        Endpoints to listen on. Empty: nothing listens.
    """

    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()

    def to_zenoh(self) -> zenoh.Config:
        """Return the Zenoh configuration.

        Raises
        ------
        WireError
            If an endpoint is not one that Zenoh understands.
        """
        settings: dict[str, object] = {
            "mode": "peer",
            "listen/endpoints": list(self.listen),
            "connect/endpoints": list(self.connect),
            # A peer that finds nobody at first keeps trying: the two ends may be started in either order.
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
            "listen/timeout_ms": 0,
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            # On by default for payloads from 3 KB, where it can drop queries without a word (zenoh#2628).
            "transport/shared_memory/enabled": False,
        }
        config = zenoh.Config()
        for name, value in settings.items():
            try:
                config.insert_json5(name, json.dumps(value))
            except zenoh.ZError as error:
                raise WireError(f"{name}: expected endpoints such as {DEFAULT_ENDPOINT}, found {value}") from error
        return config


def open_session(config: SessionConfig) -> zenoh.Session:
    """Open a session; use it as a context manager, or its threads keep the interpreter alive.

    Raises
    ------
    WireError
        If an endpoint is malformed, or is in use already.
    """
    try:
        return zenoh.open(config.to_zenoh())
    except zenoh.ZError as error:
        where = ", ".join(config.listen) or ", ".join(config.connect)
        raise WireError(
            f"no session on {where}: {_first_line(error)}; is something else listening there? "
            "give another endpoint with --listen or --connect"
        ) from error


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
