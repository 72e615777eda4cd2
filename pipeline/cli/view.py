"""The verb `view`, and the options by which other verbs show what they do."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import MOTIONS, Json, Overwrite, Renames, complete_motion, renames
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.learner.controller import Controller
    from pipeline.robot.config import RobotConfig
    from pipeline.training.trainer import Trainer
    from pipeline.views.live import LiveView
    from recorders.messages.message_types import Message
    from recorders.messages.record import Stamped

# Read when Rerun is loaded, which is after the verbs are: where one fails, it would add many lines to the one of ours.
os.environ.setdefault("RUST_LOG", "off")

View = Annotated[bool, typer.Option("--view", help="Show in Rerun's viewer what happens.")]
Viewer = Annotated[
    str | None,
    typer.Option(help="Like --view, in a viewer that runs: rerun+http://127.0.0.1:9876/proxy.", metavar="URL"),
]


def view(
    shown: Annotated[
        list[Path],
        typer.Argument(help="A log, the parts of a session, or a controller.", metavar="LOG.mcap|CONTROLLER.npz"),
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            help="Recording to write, in place of opening a window; another one there is replaced.", metavar="FILE.rrd"
        ),
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
    from recorders.files.regular_file import refuse_irregular
    from recorders.reading.parts import is_log, one_session
    from recorders.rerun_scene.recording import Destination, check_place
    from recorders.rerun_scene.viewer import check_url, open_viewer

    if overwrite and save is None:
        raise ConfigError("--overwrite: expected --save beside it")
    if save is not None and viewer is not None:
        raise ConfigError("expected one of --save and --viewer, found both")
    learned = len(shown) == 1 and not is_log(shown[0]) and is_controller(shown[0])
    if learned and (robot is not None or map_):
        raise ConfigError("--robot and --map are for logs: a controller carries its robot")
    if not learned and motion is not None:
        raise ConfigError("--motion is for controllers: a log shows the motion that it holds")
    log = one_session(shown, console.say)
    if isinstance(log, Path) and not log.is_file():
        refuse_irregular(log, expected="a log or a controller (.npz)", error=ConfigError)
        raise ConfigError(f"{log}: expected a log or a controller (.npz), found no such file")
    url = None
    if save is not None:
        check_place(save, overwrite=overwrite)
    else:
        url = check_url(viewer) if viewer is not None else open_viewer()
    to = Destination(path=save, url=url)
    if learned:
        ticks = view_controller(shown[0], to, motion=motion or "circles")
    else:
        ticks = view_log(log, to, robot=robot, renames=renames(map_))
    where = str(save) if save is not None else url
    console.show({"shown": str(log), "samples": ticks, "recording": where}, as_json=as_json)


@contextmanager
def live_view(wanted: bool, url: str | None) -> "Iterator[LiveView | None]":
    """Yield a viewer for what a verb does; None where none is wanted or can be had."""
    if not wanted and url is None:
        yield None
        return
    from pipeline.views.live import viewer

    with viewer(wanted, url, console.say) as view:
        yield view


@contextmanager
def learner_shown(wanted: bool, url: str | None, *, live: bool) -> "Iterator[Callable[..., Trainer]]":
    """Yield what makes a trainer: one that a viewer shows, or a plain one where there is no viewer."""
    from pipeline.training.trainer import Trainer

    with live_view(wanted, url) as view:
        if view is None:
            yield Trainer
            return
        from pipeline.views.learning import LearningView, ViewedTrainer

        yield partial(ViewedTrainer, view=LearningView(view, live=live))


@contextmanager
def robot_shown(
    wanted: bool, url: str | None, robot: "RobotConfig", *, title: str
) -> "Iterator[Callable[[str, Message, int], None]]":
    """Yield what takes the messages of a robot that moves: topic, message, time [ns]."""
    with live_view(wanted, url) as view:
        if view is None:
            yield lambda topic, message, time_ns: None
            return
        from pipeline.views.motion import MotionView
        from recorders.messages.topics import JOINT_STATES

        shown = MotionView(view, robot, joints_topic=JOINT_STATES, title=title)
        yield shown.feed
        shown.flush()


@contextmanager
def answers_shown(
    wanted: bool, url: str | None, controller: "Controller", *, title: str
) -> "Iterator[Callable[[bytes, tuple[Stamped, ...]], None] | None]":
    """Yield what takes the commands of a served controller: its CDR bytes, and the messages that it answers.

    None if nothing is to be shown, so that nobody looks for the messages.
    """
    with live_view(wanted, url) as view:
        if view is None:
            yield None
            return
        from pipeline.evaluation.trials import robot_of
        from pipeline.views import motion as motion_view

        with motion_view.answers_shown(view, robot_of(controller), title=title) as answered:
            yield answered
