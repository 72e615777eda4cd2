"""The verb evaluate."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.options import MOTIONS, Controller, Json, complete_motion
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.evaluation.trials import Trial
    from pipeline.learner.controller import Controller as Learned

_NOT_COMPARED = {
    "teacher_cm": "not compared: the motion is no recording; --deploy lets the teacher drive the robot, too",
    "linear_cm": "not compared: the motion is no recording; --linear-from LOG.mcap fits it",
}
"""Entries for comparisons that a result lacks: why, and how to have them."""


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
    plot: Annotated[
        Path | None,
        typer.Option(help="Picture to write: true distances beside the deviations expected.", metavar="FILE.png"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Try a controller on a motion or a recording.

    The result is the distances of the hands from their targets, and the pairs that the controller was trained with.
    """
    from pipeline.evaluation.trials import evaluate_motion
    from pipeline.learner.controller import Controller as Loaded

    if deploy and linear_from is not None:
        raise ConfigError("expected one of --deploy and --linear-from, found both")
    if deploy and plot is not None:
        raise ConfigError("expected one of --deploy and --plot, found both")
    loaded, result = Loaded.load(controller), dict[str, Any]()
    if deploy:
        result |= _deployed(loaded, motion)
    else:
        trial = evaluate_motion(loaded, motion, linear_from=linear_from)
        if plot is not None:
            _draw(plot, trial)
        result |= trial.summary()
    if not (deploy or as_json):
        result |= {name: reason for name, reason in _NOT_COMPARED.items() if name not in result}
    console.show(result | {"pairs": loaded.pairs}, as_json=as_json)


def _draw(path: Path, trial: "Trial") -> None:
    """Draw the calibration of a trial."""
    from pipeline.views.calibration import draw_calibration

    draw_calibration(path, trial)


def _deployed(controller: "Learned", motion: str) -> dict[str, float]:
    """Let the controller, then the teacher, drive the simulated robot; return the errors of its hands."""
    from pipeline.deployment.deploy import deploy
    from pipeline.evaluation.trials import robot_of
    from pipeline.motions.motion import is_recorded, load_motion

    if is_recorded(motion):
        raise ConfigError(f"--deploy: expected one of {MOTIONS}, or a CSV file, found the log {motion}")
    with console.progress("deploy") as advance:
        return deploy(controller, load_motion(motion, robot_of(controller)), progress=advance).summary()
