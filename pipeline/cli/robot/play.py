"""The verb play."""

import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import complete_robot
from pipeline.cli.sessions import LookingSession
from pipeline.terminal import console
from recorders.errors import ConfigError, MissingExtra

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from pipeline.browser.page.gate import Gate
    from pipeline.browser.page.page import Page
    from pipeline.browser.session.play import Play, PlayConfig


@dataclass(frozen=True)
class PageOptions:
    """Where the page is, and who may see it."""

    port: Annotated[
        int | None,
        typer.Option(help="Port of the page; 8080, or the next that is free.", min=1, max=65535, metavar="PORT"),
    ] = None
    host: Annotated[
        str | None,
        typer.Option(help="Address to show the page at, to other machines too; needs --token.", metavar="ADDRESS"),
    ] = None
    token: Annotated[
        str | None,
        typer.Option(help="Letters and digits that a visitor has to know; they travel unencrypted.", metavar="TOKEN"),
    ] = None
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Open no browser.")] = False

    def gate(self) -> "Gate":
        """Return who may see the page."""
        from pipeline.browser.page.gate import LOOPBACK, Gate

        return Gate(self.host or LOOPBACK, self.token or "")

    @property
    def opens(self) -> bool:
        """Whether to open a browser: on a desktop, unless told not to."""
        return not self.no_browser and any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


@grouped
def play(
    controllers: Annotated[
        list[Path] | None, typer.Argument(help="Learned controllers to lead the robot.", metavar="CONTROLLER.npz")
    ] = None,
    *,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Robot to simulate, asimo if left out; of one that runs already, what it describes itself as.",
            metavar="ROBOT",
            autocompletion=complete_robot,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the recordings that are made on the page.", metavar="DIR")
    ] = Path("play"),
    page: PageOptions,
    session: LookingSession,
) -> None:
    """Show a robot in the browser, and lead its hands there.

    Starts a simulated robot, the teacher and learned controllers, and a page; Ctrl-C ends all of it. With --connect or
    --listen it leads a robot and a controller that run already.
    """
    from pipeline.browser.session.play import playing
    from pipeline.terminal.signals import until_stopped

    if find_spec("viser") is None:  # before a robot is started
        raise MissingExtra("viser", "browser")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out: expected a folder for the recordings, found the file {out}")
    gate, config = page.gate(), _config(controllers or [], robot, session, out)
    with (
        playing(config, meanwhile=_import_page) as running,
        _served(running, gate, page.port) as shown,
        until_stopped() as stopped,
    ):
        console.notice(f"{running.robot.name} is at {shown.address}; Ctrl-C ends it")
        if page.opens:
            import webbrowser

            webbrowser.open(shown.address)
        shown.run(stopped)


def _import_page() -> None:
    """Import the page, which takes as long as the robot does to start."""
    import pipeline.browser.page.page  # noqa: F401


def _served(running: "Play", gate: "Gate", port: int | None) -> "AbstractContextManager[Page]":
    from pipeline.browser.page.page import served_page

    return served_page(running, gate, port=port)


def _config(controllers: list[Path], robot: str | None, session: LookingSession, out: Path) -> "PlayConfig":
    """Return what is played with."""
    from pipeline.browser.session.play import PlayConfig
    from pipeline.learner.controller import Controller

    keys = session.keys("play")
    if session.is_given:
        if controllers:
            raise ConfigError(
                "CONTROLLER.npz: expected none with --connect, where a controller serves already, found "
                f"{controllers[0]}; serve it with `reenact serve {controllers[0]} --connect ENDPOINT`"
            )
        return PlayConfig(robot, session=session.config(), keys=keys, folder=out)
    loaded = [Controller.load(path) for path in controllers]
    if robot is None and loaded:
        return PlayConfig(
            texts=(loaded[0].robot_toml, loaded[0].robot_urdf),
            controllers=tuple(controllers),
            keys=keys,
            folder=out,
        )
    return PlayConfig(robot, controllers=tuple(controllers), keys=keys, folder=out)
