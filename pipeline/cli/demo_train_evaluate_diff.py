"""The verbs that need no network: demo, explore in this process, train, evaluate, diff."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.interrupts import leaving
from pipeline.cli.options import (
    MOTIONS,
    AsLive,
    AsRecorded,
    Controller,
    Epochs,
    Json,
    Logs,
    Overwrite,
    Renames,
    Seed,
    StreamsRobot,
    complete_motion,
    renames,
)
from pipeline.cli.view import View, Viewer, live_view
from pipeline.terminal import console
from recorders.errors import CheckFailed, ConfigError

if TYPE_CHECKING:
    from pipeline.learner.controller import Controller as Learned


def demo(
    out: Annotated[Path, typer.Option(help="Folder for logs, controller, report and summary.", metavar="DIR")] = Path(
        "out/demo"
    ),
    seed: Seed = 0,
    epochs: Epochs = 150,
    view: View = False,
    viewer: Viewer = None,
    as_json: Json = False,
) -> None:
    """Run the main job end to end.

    Explore, record, replay over Zenoh, learn, check and report.
    """
    from pipeline.demo import REPORT, results_table, run_demo

    with live_view(view, viewer) as found:
        result = run_demo(out, seed=seed, epochs=epochs, view=found)
    if as_json:
        console.show(result.summary(out), as_json=True)
        return
    console.table(results_table(result))
    digest, took = result.file_digest[:16], sum(result.seconds.values())
    console.line(f"State digest {digest}…, over Zenoh and from the file alike. {took:.0f} s. Look at {out / REPORT}")


def train(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Controller to write.", metavar="CONTROLLER.npz")],
    seed: Seed = 0,
    epochs: Annotated[
        int | None, typer.Option(help="Epochs of training; 150, or as recorded.", min=1, metavar="N")
    ] = None,
    as_recorded: AsRecorded = False,
    as_live: AsLive = False,
    robot: StreamsRobot = None,
    map_: Renames = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Train the learner straight from logs.

    The digest is that of the same logs replayed over Zenoh.
    """
    from pipeline.learner.controller import check_writable
    from pipeline.learner.rules.reservoir.config import LearnerConfig
    from pipeline.robot.config import load_robot
    from pipeline.robot.range_check import heard_live
    from pipeline.training.trainer import Trainer, train_on
    from recorders.reading.parts import one_session, recordings
    from replay.sources.schedule import Schedule
    from replay.sources.scheduled import Replay
    from replay.sources.session import RecordedSession
    from replay.transports.transport import Source

    check_writable(out, overwrite=overwrite)
    config = None if robot is None else load_robot(robot)
    if as_recorded and as_live:
        raise ConfigError("expected one of --as-recorded and --as-live, found both")
    source: Source
    if as_recorded:
        source = RecordedSession(one_session(logs, console.say), epochs=epochs, renames=renames(map_))
    elif as_live:
        heard = one_session(logs, console.say)
        source = heard_live(heard, robot=config, epochs=epochs or 1, renames=renames(map_), say=console.say)
    else:
        source = Replay(recordings(logs, console.say), Schedule(epochs=epochs or 150), renames=renames(map_))
    with leaving(lambda: "no controller was written"), console.progress("train") as advance:
        trainer = Trainer(
            LearnerConfig(seed=seed),
            robot=config,
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / trainer.epochs),
        )
        train_on(source, trainer)
    trainer.check_learned()
    trainer.controller().save(out)
    console.show(trainer.result() | {"controller": str(out)}, as_json=as_json)


def evaluate(
    controller: Controller,
    motion: Annotated[
        str,
        typer.Argument(
            help=f"A log, a CSV file, or one of {MOTIONS}; samples are taken in order.",
            metavar="MOTION|LOG.mcap",
            autocompletion=complete_motion,
        ),
    ],
    linear_from: Annotated[
        Path | None,
        typer.Option(help="Log that linear least squares is fitted to; by default the one tried.", metavar="LOG.mcap"),
    ] = None,
    deploy: Annotated[
        bool,
        typer.Option("--deploy", help="Let it move the simulated robot, through serve, at 10 Hz; then the teacher."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Try a controller on a motion or a recording.

    The result is the distances of both hands from their targets.
    """
    from pipeline.evaluation.trials import try_motion
    from pipeline.learner.controller import Controller as Loaded

    if deploy and linear_from is not None:
        raise ConfigError("expected one of --deploy and --linear-from, found both")
    loaded = Loaded.load(controller)
    if deploy:
        result = _deployed(loaded, motion)
    else:
        result = try_motion(loaded, motion, linear_from=linear_from, say=console.say).summary()
    console.show(result, as_json=as_json)


def diff(
    a: Annotated[Path, typer.Argument(help="A log or a controller.", metavar="A")],
    b: Annotated[Path, typer.Argument(help="Another of the same kind.", metavar="B")],
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            help="Of two logs, what does not count: a field, such as sequence, header.stamp or effort, or a pattern of "
            "topics, such as '/tf'; then values are compared, not bytes. May be repeated.",
            metavar="FIELD|PATTERN",
        ),
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Of two logs: how far two numbers may be apart.", metavar="NUMBER")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(help="Of two logs: pattern of topics to compare; all if left out.", metavar="PATTERN"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Name the first divergence of two logs or two controllers.

    Exit status 1 if there is one.
    """
    from pipeline.cli.diff_files import DiffConfig
    from pipeline.cli.diff_files import diff as run

    found = run(a, b, DiffConfig(tuple(topic or ()), tuple(ignore or ()), tolerance), say=console.say)
    if as_json:
        console.show({"equal": found is None, "first_divergence": found and asdict(found)}, as_json=True)
    else:
        console.line("no divergence" if found is None else str(found))
    if found is not None:
        raise typer.Exit(CheckFailed.exit_status)


def _deployed(controller: "Learned", motion: str) -> dict[str, float]:
    """Let the controller, and then the teacher, lead the simulated robot; return how far its hands are off."""
    from pipeline.deployment.deploy import deploy
    from pipeline.evaluation.trials import robot_of
    from pipeline.motions.motion import is_recorded, load_motion

    if is_recorded(motion):
        raise ConfigError(f"--deploy: expected one of {MOTIONS}, or a CSV file, found the log {motion}")
    with console.progress("deploy") as advance:
        return deploy(controller, load_motion(motion, robot_of(controller)), progress=advance).summary()
