"""Gate of the page: which connections may see and lead the robot."""

import hmac
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from recorders.errors import ConfigError

LOOPBACK = "127.0.0.1"
MIN_TOKEN = 16
"""Shortest token: what is shorter can be guessed over a network."""

_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_ALL = ("0.0.0.0", "::")  # noqa: S104  # only compared with


@dataclass(frozen=True)
class Gate:
    """Host and token of the page.

    A page that only this machine sees asks for no token. But any page of the web that is open in a browser of this
    machine could connect to it, too: so a connection has to come from the page itself, by its `Origin`, and name the
    machine as itself, by its `Host`.

    Attributes
    ----------
    host : str
        Address to listen on.
    token : str
        What a visitor from elsewhere has to know; empty on loopback.

    Raises
    ------
    ConfigError
        If the page were to be seen from elsewhere without a token, or with a short one.
    """

    host: str = LOOPBACK
    token: str = ""

    def __post_init__(self) -> None:
        if self.host not in (LOOPBACK, "localhost", "::1") and not self.token:
            raise ConfigError(
                f"--host {self.host}: expected --token beside it: whoever reaches the page leads the robot, found none"
            )
        if self.token and (len(self.token) < MIN_TOKEN or not self.token.isascii() or not self.token.isalnum()):
            raise ConfigError(
                f"--token: expected at least {MIN_TOKEN} letters and digits, such as of `openssl rand -hex 16`, "
                "found fewer or others"
            )

    def refusal(self, path: str, headers: Mapping[str, str]) -> str:
        """Return why a connection is refused, empty if it is not.

        Parameters
        ----------
        path : str
            What it asks for, with its query.
        headers : mapping of str to str
            Its headers.
        """
        try:
            return self._refusal(path, headers)
        except (ValueError, LookupError):  # an address that is none, a header that occurs twice
            return "it is no request of a browser"

    def _refusal(self, path: str, headers: Mapping[str, str]) -> str:
        host = headers.get("Host", "")
        origin = headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return "it comes from another page"
        if self.token:
            given = parse_qs(urlsplit(path).query).get("token", [""])[0]
            return "" if hmac.compare_digest(given.encode(), self.token.encode()) else "the token is not the right one"
        return "" if host.rpartition(":")[0] in _LOCAL else "it names another host"

    def address(self, port: int) -> str:
        """Return the address of the page at a port; where it listens on all addresses, by the machine's name."""
        name = socket.gethostname() if self.host in _ALL else self.host
        host = f"[{name}]" if ":" in name else name
        if not self.token:
            return f"http://{host}:{port}"
        return f"http://{host}:{port}/?websocket=ws://{host}:{port}/?token={self.token}"
