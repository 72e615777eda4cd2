"""Options that several verbs share, and what their values mean."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.motions.names import motion_names
from pipeline.resources import data_path
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from recorders.wire.session import SessionConfig

MOTIONS = ", ".join(motion_names())
"""The motions that come with the program, for the help."""


def complete_motion(incomplete: str) -> list[str]:
    """Return the motions whose names begin so, for the shell."""
    return [name for name in motion_names() if name.startswith(incomplete)]


def complete_robot(incomplete: str) -> list[str]:
    """Return the robots whose names begin so, for the shell."""
    return sorted(folder.name for folder in data_path("robots").glob(f"{incomplete}*/"))


Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Seed = Annotated[int, typer.Option(help="Seed of every random draw.", min=0, metavar="N")]
Epochs = Annotated[int, typer.Option(help="Epochs of training: 150 for circles, 600 for eight.", min=1, metavar="N")]
Logs = Annotated[list[Path], typer.Argument(help="Logs, presented in this order.", metavar="LOG.mcap")]
Controller = Annotated[Path, typer.Argument(help="A learned controller.", metavar="CONTROLLER.npz")]
Robot = Annotated[
    str,
    typer.Option(
        help="Robot that comes with the program, or a folder of one.", metavar="ROBOT", autocompletion=complete_robot
    ),
]
StreamsRobot = Annotated[
    str | None, typer.Option(help="Robot; by default the one that the stream or log names.", metavar="ROBOT")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the file; a crash's .part is set aside.")]
AsRecorded = Annotated[bool, typer.Option("--as-recorded", help="Follow the phase markers of a recorded session.")]
AsLive = Annotated[bool, typer.Option("--as-live", help="Take the messages as `learn --live` would have taken them.")]
Renames = Annotated[
    list[str] | None, typer.Option("--map", help="FOREIGN=OURS: rename a topic.", metavar="FOREIGN=OURS")
]
# Of a verb that connects, unless it is told to listen; its default is `recorders.wire.session.DEFAULT_ENDPOINT`.
Listen = Annotated[
    list[str] | None,
    typer.Option(help="Endpoint to listen on, in place of connecting; may be repeated.", metavar="ENDPOINT"),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        help="Endpoint to connect to; tcp/127.0.0.1:7447 unless --listen is given. May be repeated.", metavar="ENDPOINT"
    ),
]
# Of a verb that listens, unless it is told to connect.
ListenFirst = Annotated[
    list[str] | None,
    typer.Option(
        "--listen",
        help="Endpoint to listen on; tcp/127.0.0.1:7447 unless --connect is given. May be repeated.",
        metavar="ENDPOINT",
    ),
]
ConnectInstead = Annotated[
    list[str] | None,
    typer.Option(
        "--connect", help="Endpoint to connect to, in place of listening; may be repeated.", metavar="ENDPOINT"
    ),
]
Namespace = Annotated[str, typer.Option(help="First part of every Zenoh key.", metavar="KEY")]
Prometheus = Annotated[
    int | None,
    typer.Option(help="Port on 127.0.0.1 at which Prometheus may read the status.", min=1, max=65535, metavar="PORT"),
]
ZenohConfig = Annotated[
    Path | None, typer.Option(help="Zenoh configuration (JSON5): credentials, TLS, access control.", metavar="FILE")
]
Await = Annotated[
    list[str] | None, typer.Option("--await", help="Consumer to feed and wait for; may be repeated.", metavar="NAME")
]
Wait = Annotated[float, typer.Option(help="How long to wait for the other end to appear.", min=0, metavar="SECONDS")]

_EXPOSED = (
    "warning: listens beyond this machine at {}: without credentials, whoever reaches it may read everything, command "
    "the robot and feed the learner; see data/zenoh/README.md"
)


def help_without_verb(ctx: typer.Context) -> None:
    """Print the help, and end with status 2, where the command line names no verb."""
    if ctx.invoked_subcommand is None:
        console.block(ctx.get_help())
        raise typer.Exit(2)


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
        console.say(_EXPOSED.format(", ".join(exposed)))
    return resolved


def renames(pairs: list[str] | None) -> dict[str, str]:
    """Parse FOREIGN=OURS pairs.

    Raises
    ------
    ConfigError
        If one is not such a pair, or a topic is named twice.
    """
    found: dict[str, str] = {}
    for pair in pairs or ():
        foreign, equals, ours = pair.partition("=")
        if not (foreign and equals and ours) or foreign in found:
            raise ConfigError(f"--map: expected FOREIGN=OURS, each topic once, found {pair!r}")
        found[foreign] = ours
    return found
