"""Options of every verb that opens a Zenoh session, listed once."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.project_settings import of_settings
from pipeline.cli.ros_domain import Humble, Remap, RosDomain, topic_keys
from pipeline.terminal import console

if TYPE_CHECKING:
    from recorders.wire.keys.topic_keys import TopicKeys
    from recorders.wire.session import SessionConfig

NAMESPACE = "reenact"

Namespace = Annotated[str, typer.Option(help="First part of every Zenoh key.", metavar="KEY")]
ZenohConfig = Annotated[
    Path | None, typer.Option(help="Zenoh configuration (JSON5): credentials, TLS, access control.", metavar="FILE")
]
Await = Annotated[
    list[str] | None, typer.Option("--await", help="Consumer to feed and wait for; may be repeated.", metavar="NAME")
]
Wait = Annotated[
    float,
    typer.Option(
        help="How long to wait for the other end to appear; a consumer has as long again to accept.",
        min=0,
        metavar="SECONDS",
    ),
]
StreamKey = Annotated[
    Path | None,
    typer.Option(help="Key that both ends of a stream share: 64 hexadecimal digits; yours alone.", metavar="FILE"),
]
_Prometheus = Annotated[
    int | None,
    typer.Option(help="Port on 127.0.0.1 at which Prometheus may read the status.", min=1, max=65535, metavar="PORT"),
]

_EXPOSED = (
    "warning: listens beyond this machine at {}: without credentials, whoever reaches it may read everything, command "
    "the robot and feed the learner; see data/zenoh/README.md"
)


@dataclass(frozen=True)
class ListeningSession:
    """Session of a verb that listens, unless `--connect` is given."""

    listen: Annotated[
        list[str] | None,
        typer.Option(
            help="Endpoint to listen on; tcp/127.0.0.1:7447 unless --connect is given, or --ros. May be repeated.",
            metavar="ENDPOINT",
        ),
    ] = None
    connect: Annotated[
        list[str] | None,
        typer.Option(
            help="Endpoint to connect to, in place of listening; with --ros tcp/127.0.0.1:7447. May be repeated.",
            metavar="ENDPOINT",
        ),
    ] = None
    zenoh_config: ZenohConfig = None
    namespace: Namespace = NAMESPACE
    ros: RosDomain = None
    remap: Remap = None
    humble: Humble = False

    def keys(self, name: str) -> "TopicKeys":
        """Return the keys of topics, for a node of a name."""
        return topic_keys(name, self.namespace, self.ros, self.remap, humble=self.humble)

    def config(self) -> "SessionConfig":
        """Return where the session listens and connects: in a ROS domain it is the router that listens."""
        return session_config(self.listen, self.connect, self.zenoh_config, listens=self.ros is None)


@dataclass(frozen=True)
class LookingSession:
    """Session of a verb that looks on only if it is asked to."""

    listen: Annotated[
        list[str] | None, typer.Option(help="Endpoint to listen on; may be repeated.", metavar="ENDPOINT")
    ] = None
    connect: Annotated[
        list[str] | None, typer.Option(help="Endpoint to connect to; may be repeated.", metavar="ENDPOINT")
    ] = None
    zenoh_config: ZenohConfig = None
    namespace: Namespace = NAMESPACE
    ros: RosDomain = None
    remap: Remap = None
    humble: Humble = False

    def keys(self, name: str) -> "TopicKeys":
        """Return the keys of topics, for a node of a name; where no session is asked for, those of a namespace."""
        return topic_keys(name, self.namespace, self.ros if self.is_given else None, self.remap, humble=self.humble)

    @property
    def is_given(self) -> bool:
        """Whether a session is asked for; a domain of the settings is for those that are."""
        in_ros = self.ros is not None and not of_settings("ros")
        return in_ros or bool(self.listen or self.connect or self.zenoh_config)

    def config(self) -> "SessionConfig":
        """Return where the session listens and connects."""
        return session_config(self.listen, self.connect, self.zenoh_config, listens=False)


@dataclass(frozen=True)
class ListeningNode(ListeningSession):
    """Session of a verb that listens and has a status."""

    prometheus: _Prometheus = None


@dataclass(frozen=True)
class StreamingNode(ListeningNode):
    """Session of a verb that listens, takes a stream, and has a status."""

    key: StreamKey = None


@dataclass(frozen=True)
class ConnectingNode:
    """Session of a verb that connects, unless `--listen` is given, sends or takes a stream, and has a status."""

    listen: Annotated[
        list[str] | None,
        typer.Option(help="Endpoint to listen on, in place of connecting; may be repeated.", metavar="ENDPOINT"),
    ] = None
    connect: Annotated[
        list[str] | None,
        typer.Option(
            help="Endpoint to connect to; tcp/127.0.0.1:7447 unless --listen is given. May be repeated.",
            metavar="ENDPOINT",
        ),
    ] = None
    zenoh_config: ZenohConfig = None
    namespace: Namespace = NAMESPACE
    ros: RosDomain = None
    remap: Remap = None
    humble: Humble = False
    prometheus: _Prometheus = None
    key: StreamKey = None

    def keys(self, name: str) -> "TopicKeys":
        """Return the keys of topics, for a node of a name."""
        return topic_keys(name, self.namespace, self.ros, self.remap, humble=self.humble)

    def config(self, *, wait_s: float = 10.0) -> "SessionConfig":
        """Return where the session listens and connects."""
        return session_config(self.listen, self.connect, self.zenoh_config, listens=False, wait_s=wait_s)


def session_config(
    listen: list[str] | None,
    connect: list[str] | None,
    config_file: Path | None,
    *,
    listens: bool,
    wait_s: float = 10.0,
) -> "SessionConfig":
    """Return where a session listens and connects; a verb that `listens` does so by default, the others connect.

    Warns on standard error of endpoints that other machines may reach.
    """
    from recorders.wire.session import DEFAULT_ENDPOINT, SessionConfig, beyond_loopback

    config = SessionConfig(
        listen=tuple(listen or ()), connect=tuple(connect or ()), config_file=config_file, wait_s=wait_s
    )
    default = (DEFAULT_ENDPOINT,)
    resolved = config.resolved(listen=default) if listens else config.resolved(connect=default)
    if exposed := beyond_loopback(resolved.listen):
        console.notice(_EXPOSED.format(", ".join(exposed)))
    return resolved
