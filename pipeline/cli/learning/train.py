"""The verb train."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.interrupts import note_on_interrupt
from pipeline.cli.options import (
    AsLive,
    AsRecorded,
    Json,
    LearnerFile,
    Logs,
    Overwrite,
    Pairs,
    Rule,
    Seed,
    StreamsRobot,
    learner_settings,
)
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.learner.controller import Controller
    from pipeline.learner.rule import Settings
    from pipeline.robot.config import RobotConfig
    from pipeline.samples.pairing import PairingRule
    from pipeline.training.trainer import Trainer
    from recorders.containers.reader import Opened
    from replay.transports.transport import Source


@grouped
def train(
    logs: Logs,
    *,
    out: Annotated[Path, typer.Option(help="Controller to write.", metavar="CONTROLLER.npz")],
    seed: Seed = 0,
    rule: Rule = None,
    pairs: Pairs = None,
    settings: LearnerFile = None,
    epochs: Annotated[
        int | None,
        typer.Option(
            help="Epochs of training; as many as the rule takes (reservoir: 150), or as recorded.", min=1, metavar="N"
        ),
    ] = None,
    as_recorded: AsRecorded = False,
    as_live: AsLive = False,
    robot: StreamsRobot = None,
    alignment: AlignmentOptions,
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave the last share of each log aside, such as 0.2, or whole logs, and report the error on them.",
            metavar="SHARE|LOG",
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Train the learner straight from logs.

    The digest is that of the same logs replayed over Zenoh. The ticks are those of all cycles of all epochs, and the
    steps what the learner took of them: with pairs commanded the last tick of a cycle ends a step and begins none.
    """
    from pipeline.learner.controller import check_writable
    from pipeline.robot.config import load_robot
    from pipeline.training.pairing_choice import pairing_for, pairing_of
    from recorders.reading.parts import one_session, recordings

    check_writable(out, overwrite=overwrite)
    config = None if robot is None else load_robot(robot)
    _check_ways(alignment, hold_out, as_recorded=as_recorded, as_live=as_live)
    learner, pairs = learner_settings(settings, rule, pairs, seed)
    found: Sequence[Opened] = [one_session(logs)] if as_recorded or as_live else recordings(logs)
    asked, whole = pairing_of(learner, pairs), _whole_logs(hold_out)
    alignment = alignment.of_logs([*found, *whole])
    names: Mapping[str, str] = alignment.renames
    if not as_recorded:
        found, names = _aligned([*found, *whole], alignment, config, asked)
    found, aside = _left_aside(found, hold_out or [], names, len(whole))
    pairing = pairing_for(asked, found, robot=config, renames=names, as_recorded=as_recorded)
    source = (
        _as_live(found[0], config, epochs or 1, names, pairing)
        if as_live
        else _from_logs(found, config, learner, epochs, names, pairing, as_recorded=as_recorded)
    )
    trainer = _trained(learner, config, pairing, source)
    notes = _notes(trainer, as_json=as_json)
    controller = _saved(trainer, out)
    left = _held_out(controller, aside, config, pairing, names, as_json=as_json)
    _show(trainer, {"pairs": controller.pairs, "controller": str(out)} | left | notes, as_json=as_json)


def _show(trainer: "Trainer", others: dict[str, object], *, as_json: bool) -> None:
    """Print the result of a training, with what else there is of it."""
    from pipeline.terminal.training_lines import training_lines

    result = trainer.result() if as_json else training_lines(trainer.result(), trainer.cycles)
    console.show(result | others, as_json=as_json)


def _check_ways(alignment: AlignmentOptions, hold_out: list[str] | None, *, as_recorded: bool, as_live: bool) -> None:
    """Check that options go together; raises ConfigError."""
    if as_recorded and as_live:
        raise ConfigError("expected one of --as-recorded and --as-live, found both")
    if hold_out and (as_recorded or as_live):
        raise ConfigError("--hold-out: expected neither --as-recorded nor --as-live beside it")
    if as_recorded:
        alignment.refuse("--as-recorded")


def _notes(trainer: "Trainer", *, as_json: bool) -> dict[str, object]:
    """Check that the robot moved, and return what teaches little as an entry of the result."""
    notes = trainer.check_moved()
    return {"notes": notes if as_json else "; ".join(notes)} if notes else {}


def _saved(trainer: "Trainer", out: Path) -> "Controller":
    """Save what was learned, print the notes on it, and return it."""
    controller = trainer.controller()
    controller.save(out)
    for line in controller.config.notes():
        console.notice(line)
    return controller


def _whole_logs(hold_out: list[str] | None) -> "Sequence[Opened]":
    """Return the logs that are left aside whole."""
    from recorders.reading.parts import recordings

    return recordings([Path(text) for text in hold_out or () if not _is_number(text)])


def _aligned(
    logs: "Sequence[Opened]", alignment: AlignmentOptions, robot: "RobotConfig | None", pairing: "PairingRule"
) -> "tuple[Sequence[Opened], Mapping[str, str]]":
    """Return logs of ticks of what is learned, and the renames that are left to make."""
    from pipeline.robot.recorded import recorded_hands

    tick = pairing.topics(recorded_hands(logs[0], robot=robot, renames=alignment.renames))
    return alignment.align(logs, robot=robot, tick=tick)


def _held_out(
    controller: "Controller",
    aside: "list[Opened]",
    robot: "RobotConfig | None",
    pairing: "PairingRule",
    names: "Mapping[str, str]",
    *,
    as_json: bool,
) -> dict[str, object]:
    """Return the error on what was left aside, as it is shown; nothing if nothing was."""
    from pipeline.evaluation.hold_out import held_out_error
    from pipeline.evaluation.trials import robot_of
    from pipeline.robot.size import joint_units
    from pipeline.terminal.training_lines import held_out_lines

    if not aside:
        return {}
    left = held_out_error(controller, aside, robot=robot, pairs=pairing.name, renames=names)
    return {"held_out": left} if as_json else held_out_lines(left, joint_units(robot_of(controller)))


def _trained(learner: "Settings", robot: "RobotConfig | None", pairing: "PairingRule", source: "Source") -> "Trainer":
    """Return a learner that has learned all of a source."""
    from pipeline.training.trainer import Trainer, train_on

    with note_on_interrupt(lambda: "no controller was written"), console.progress("train") as advance:
        trainer = Trainer(
            learner,
            robot=robot,
            pairs=pairing.name,
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / trainer.epochs),
        )
        train_on(source, trainer)
    trainer.check_learned()
    return trainer


def _left_aside(
    logs: "Sequence[Opened]", hold_out: list[str], names: "Mapping[str, str]", whole: int
) -> "tuple[Sequence[Opened], list[Opened]]":
    """Return what is learned and what is left aside: so many logs at the end of the list, or the ends of all logs."""
    from pipeline.evaluation.hold_out import parse_share, split_log

    if not hold_out:
        return logs, []
    shares = [text for text in hold_out if _is_number(text)]
    if len(shares) > 1 or (shares and whole):
        raise ConfigError("--hold-out: expected one share, or logs, found both or several shares")
    if whole:
        return logs[:-whole], list(logs[-whole:])
    learned, aside = zip(*(split_log(log, parse_share(shares[0]), names) for log in logs), strict=True)
    return learned, list(aside)


def _is_number(text: str) -> bool:
    return text.replace(".", "", 1).isdecimal()


def _as_live(
    log: "Opened", robot: "RobotConfig | None", epochs: int, names: "Mapping[str, str]", pairing: "PairingRule"
) -> "Source":
    from pipeline.robot.range_check import live_log
    from pipeline.robot.recorded import recorded_hands

    topics = pairing.topics(recorded_hands(log, robot=robot, renames=names))
    return live_log(log, robot=robot, epochs=epochs, tick=topics, renames=names)


def _from_logs(
    logs: "Sequence[Opened]",
    robot: "RobotConfig | None",
    learner: "Settings",
    epochs: int | None,
    names: "Mapping[str, str]",
    pairing: "PairingRule",
    *,
    as_recorded: bool,
) -> "Source":
    """Return logs as their learner is to be presented them, or a session as it was recorded."""
    from pipeline.robot.recorded import recorded_hands
    from recorders.containers.opening import open_log
    from replay.sources.scheduled import Replay
    from replay.sources.session import RecordedSession

    topics = pairing.topics(recorded_hands(logs[0], robot=robot, renames=names))
    if as_recorded:
        return RecordedSession(open_log(logs[0]).path, epochs=epochs, renames=names, topics=topics)
    return Replay(logs, learner.schedule(epochs, topics), renames=names)
