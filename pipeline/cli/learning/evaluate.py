"""The verb evaluate."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import MOTIONS, Controller, Json, complete_motion
from pipeline.terminal import console
from recorders.errors import ConfigError
from recorders.text.quantities import decimal_text
from recorders.text.wording import names_text

if TYPE_CHECKING:
    from pipeline.evaluation.trials import Trial
    from pipeline.learner.controller import Controller as Learned
    from pipeline.motions.motion import Motion
    from recorders.containers.reader import Reader

_NOT_COMPARED = {
    "teacher_cm": "not compared: the motion is no recording; --deploy lets the teacher drive the robot, too",
    "linear_cm": "not compared: the motion is no recording; --linear-from LOG.mcap fits it",
}
"""Entries for comparisons that a result lacks: why, and how to have them."""


@grouped
def evaluate(
    controller: Controller,
    motion: Annotated[
        str,
        typer.Argument(
            help=f"A log or a bag, a CSV file, or one of {MOTIONS}; samples are taken in order.",
            metavar="MOTION|LOG.mcap",
            autocompletion=complete_motion,
        ),
    ],
    *,
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
    own_time: Annotated[
        bool,
        typer.Option(
            "--own-time",
            help="With --deploy: the motion in its own time, with targets at 10 and 50 Hz, in this process; beside the "
            "teacher, Drake's inverse kinematics and, where installed, pink; with the errors after 1 s on a target.",
        ),
    ] = False,
    alignment: AlignmentOptions,
    as_json: Json = False,
) -> None:
    """Try a controller on a motion or a recording.

    The result is the distances of the hands from their targets, and the pairs that the controller was trained with.
    Beside them are those of the joints as recorded: of the teacher, in an exploration.
    """
    from pipeline.learner.controller import Controller as Loaded

    _check_ways(linear_from, plot, deploy=deploy, own_time=own_time)
    if deploy:
        alignment.refuse("--deploy", renames=True)
    loaded, result = Loaded.load(controller), dict[str, Any]()
    if own_time:
        _deploy_in_own_time(loaded, motion, as_json=as_json)
        _note_outside(loaded, motion)
        return
    if deploy:
        result |= _deployed(loaded, motion)
    else:
        trial = _tried(loaded, motion, linear_from, alignment)
        if plot is not None:
            _draw(plot, trial)
        result |= trial.summary() | _doubts(trial, as_json=as_json)
    if not (deploy or as_json):
        result = _worded(result, motion)
    console.show(result | {"pairs": loaded.pairs}, as_json=as_json)
    _note_outside(loaded, motion)


def _worded(result: dict[str, Any], motion: str) -> dict[str, Any]:
    """Return a result as people read it: with what was not compared, and why; of a foreign recording, no teacher."""
    if (within := result.get("within_deviation")) is not None:
        result = result | {"within_deviation": f"{decimal_text(within)} of the distances"}
    worded = result | {name: reason for name, reason in _NOT_COMPARED.items() if name not in result}
    if _is_of_others(motion):
        worded = {name.replace("teacher_", "recorded_"): value for name, value in worded.items()}
    return worded


def _check_ways(linear_from: Path | None, plot: Path | None, *, deploy: bool, own_time: bool) -> None:
    """Raise ConfigError if options exclude each other, or one lacks another."""
    if deploy and linear_from is not None:
        raise ConfigError("expected one of --deploy and --linear-from, found both")
    if deploy and plot is not None:
        raise ConfigError("expected one of --deploy and --plot, found both")
    if own_time and not deploy:
        raise ConfigError("--own-time: expected --deploy beside it")


def _is_of_others(motion: str) -> bool:
    """Whether a motion is a recording in which no teacher of ours moved the robot, so far as it states."""
    from pipeline.motions.motion import is_recorded
    from recorders.containers.opening import open_log
    from recorders.reading.parts import one_session

    if not is_recorded(motion):
        return False
    return bool(open_log(one_session([Path(motion)])).manifest.get("kind", "recording") == "recording")


def _note_outside(controller: "Learned", motion: str) -> None:
    """Print a line for a motion, not a recording, that leaves the boxes of the robot's hands."""
    from pipeline.evaluation.outside_boxes import outside_boxes_text
    from pipeline.evaluation.trials import robot_of
    from pipeline.motions.motion import is_recorded, load_motion

    if not is_recorded(motion):
        robot = robot_of(controller)
        loaded = load_motion(motion, robot)
        if (line := outside_boxes_text(robot, loaded.name, loaded.targets)) is not None:
            console.notice(line)


def _doubts(trial: "Trial", *, as_json: bool) -> dict[str, str]:
    """Return a line on deviations that do not hold as an entry of a result that is read."""
    return {"deviations": doubt} if not as_json and (doubt := trial.doubt) else {}


def _tried(controller: "Learned", motion: str, linear_from: Path | None, alignment: AlignmentOptions) -> "Trial":
    """Try a controller; recordings that carry no ticks are aligned."""
    from pipeline.evaluation.trials import evaluate_motion
    from pipeline.motions.motion import is_recorded
    from recorders.containers.opening import open_log
    from recorders.reading.parts import one_session
    from replay.sources.scheduled import check_renames

    recorded = [Path(motion)] if is_recorded(motion) else []
    logs = [open_log(one_session([path])) for path in (*recorded, linear_from) if path is not None]
    if not logs:
        alignment.refuse(motion, renames=True)
    else:
        alignment = alignment.of_logs(logs)
        topics = {topic for log in logs for topic in log.topics}
        check_renames(alignment.renames, topics, where=names_text(str(log.path) for log in logs))
    aligned = [_aligned(controller, log, alignment.among(log.topics)) for log in logs]
    linear, linear_renames = (None, {}) if linear_from is None else aligned.pop()
    tried, renames = aligned.pop() if aligned else (motion, {})
    return evaluate_motion(controller, tried, linear_from=linear, renames=renames, linear_renames=linear_renames)


def _aligned(controller: "Learned", log: "Reader", alignment: AlignmentOptions) -> "tuple[Reader, Mapping[str, str]]":
    """Return a log of ticks, and the renames that are left to make in it."""
    from pipeline.evaluation.trials import robot_of, trial_pairing
    from recorders.containers.opening import open_log

    robot = robot_of(controller)
    tick = trial_pairing(log, robot.hand_names, alignment.renames).topics(robot.hand_names)
    (aligned,), renames = alignment.align([log], robot=robot, tick=tick)
    return open_log(aligned), renames


def _draw(path: Path, trial: "Trial") -> None:
    """Draw the calibration of a trial."""
    from pipeline.views.calibration import draw_calibration

    draw_calibration(path, trial)


def _deployed(controller: "Learned", motion: str) -> dict[str, float]:
    """Let the controller, then the teacher, drive the simulated robot; return the errors of its hands."""
    from pipeline.deployment.deploy import deploy

    with console.progress("deploy") as advance:
        return deploy(controller, _motion(controller, motion), progress=advance).summary()


def _deploy_in_own_time(controller: "Learned", motion: str, *, as_json: bool) -> None:
    from pipeline.deployment.real_time import deploy_in_real_time, lag_sentences

    with console.progress("deploy") as advance:
        errors = deploy_in_real_time(controller, _motion(controller, motion), progress=advance)
    result: dict[str, Any] = {}
    for error in errors:
        key = f"{error.leader}_{error.tick_rate_hz}_hz"
        result |= {f"{key}_cm": error.moving_cm, f"{key}_settled_cm": error.settled_cm}
        result |= {f"{key}_{hand}_deg": angle for hand, angle in error.moving_deg.items()}
        result |= {f"{key}_{hand}_settled_deg": angle for hand, angle in error.settled_deg.items()}
    sentences = list(lag_sentences(errors))
    console.show(result | ({"lag": sentences} if as_json else {}) | {"pairs": controller.pairs}, as_json=as_json)
    if not as_json:
        for sentence in sentences:
            console.line(sentence)


def _motion(controller: "Learned", motion: str) -> "Motion":
    """Return what the robot is to do."""
    from pipeline.evaluation.trials import robot_of
    from pipeline.motions.motion import is_recorded, load_motion

    if is_recorded(motion):
        raise ConfigError(f"--deploy: expected one of {MOTIONS}, or a CSV file, found the log {motion}")
    return load_motion(motion, robot_of(controller))
