"""The verb view."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.options import MOTIONS, Json, Overwrite, Renames, complete_motion
from pipeline.cli.project_settings import of_settings
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from recorders.reading.parts import Log
    from recorders.rerun_scene.recording import Destination


def view(
    shown: Annotated[
        list[Path],
        typer.Argument(help="A log, the parts of a session, or a controller.", metavar="LOG.mcap|CONTROLLER.npz"),
    ],
    save: Annotated[
        Path | None,
        typer.Option(help="Recording to write, in place of opening a window.", metavar="FILE.rrd"),
    ] = None,
    viewer: Annotated[
        str | None, typer.Option(help="Viewer that runs: rerun+http://127.0.0.1:9876/proxy.", metavar="URL")
    ] = None,
    motion: Annotated[
        str | None,
        typer.Option(
            help=f"For a controller: one of {MOTIONS}, a CSV file or a log; circles if left out.",
            metavar="MOTION",
            autocompletion=complete_motion,
        ),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="For a log that carries no robot: its name or folder.", metavar="ROBOT")
    ] = None,
    map_: Renames = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Look at a log or a controller in Rerun's viewer.

    It shows robot, hands, joints, errors and network; nothing leaves the machine.
    """
    from pipeline.learner.controller import is_controller
    from pipeline.views.view import view_controller, view_log
    from recorders.reading.parts import is_log, one_session

    if overwrite and save is None:
        raise ConfigError("--overwrite: expected --save beside it")
    if save is not None and viewer is not None:
        raise ConfigError("expected one of --save and --viewer, found both")
    learned = len(shown) == 1 and not is_log(shown[0]) and is_controller(shown[0])
    if learned and ((robot is not None and not of_settings("robot")) or (map_ and not of_settings("map"))):
        raise ConfigError("--robot and --map are for logs: a controller carries its robot")
    if not learned and motion is not None:
        raise ConfigError("--motion is for controllers: a log shows the motion that it holds")
    log = one_session(shown)
    _require_file(log)
    to = _destination(save, viewer, overwrite=overwrite)
    if learned:
        ticks = view_controller(shown[0], to, motion=motion or "circles")
    else:
        ticks = view_log(log, to, robot=robot, renames=AlignmentOptions(map_=map_).of_logs([log]).renames)
    where = str(save) if save is not None else to.url
    console.show({"shown": str(log), "samples": ticks, "recording": where}, as_json=as_json)


def _require_file(log: "Log") -> None:
    from recorders.files.regular_file import require_regular_file
    from recorders.reading.parts import is_log

    if isinstance(log, Path) and not (log.is_file() or (log.is_dir() and is_log(log))):
        require_regular_file(log, expected="a log or a controller (.npz)", error=ConfigError)
        raise ConfigError(f"{log}: no such file; expected a log or a controller (.npz)")


def _destination(save: Path | None, viewer: str | None, *, overwrite: bool) -> "Destination":
    from recorders.rerun_scene.recording import Destination, check_place
    from recorders.rerun_scene.viewer import check_url, open_viewer

    if save is not None:
        check_place(save, overwrite=overwrite)
        return Destination(path=save, url=None)
    return Destination(path=None, url=check_url(viewer) if viewer is not None else open_viewer())
