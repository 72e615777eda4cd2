"""The verb train."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.interrupts import note_on_interrupt
from pipeline.cli.options import (
    AsLive,
    AsRecorded,
    Json,
    Logs,
    Overwrite,
    Pairs,
    Renames,
    Rule,
    Seed,
    StreamsRobot,
    renames,
)
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.learner.rule import Settings
    from pipeline.robot.config import RobotConfig
    from pipeline.samples.pairing import PairingRule
    from replay.transports.transport import Source


def train(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Controller to write.", metavar="CONTROLLER.npz")],
    seed: Seed = 0,
    rule: Rule = None,
    pairs: Pairs = None,
    epochs: Annotated[
        int | None,
        typer.Option(
            help="Epochs of training; as many as the rule takes (reservoir: 150), or as recorded.", min=1, metavar="N"
        ),
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
    from pipeline.learner.registry import default_config
    from pipeline.robot.config import load_robot
    from pipeline.training.trainer import Trainer, pairing_of, train_on

    check_writable(out, overwrite=overwrite)
    config = None if robot is None else load_robot(robot)
    if as_recorded and as_live:
        raise ConfigError("expected one of --as-recorded and --as-live, found both")
    learner = default_config(rule, seed=seed)
    pairing, names = pairing_of(learner, pairs), renames(map_)
    if as_live:
        source = _as_live(logs, config, epochs or 1, names, pairing)
    else:
        source = _from_logs(logs, config, learner, epochs, names, pairing, as_recorded=as_recorded)
    with note_on_interrupt(lambda: "no controller was written"), console.progress("train") as advance:
        trainer = Trainer(
            learner,
            robot=config,
            pairs=pairs,
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / trainer.epochs),
        )
        train_on(source, trainer)
    trainer.check_learned()
    controller = trainer.controller()
    controller.save(out)
    for line in controller.config.notes():
        console.notice(line)
    console.show(trainer.result() | {"controller": str(out)}, as_json=as_json)


def _as_live(
    logs: list[Path], robot: "RobotConfig | None", epochs: int, names: dict[str, str], pairing: "PairingRule"
) -> "Source":
    from pipeline.robot.range_check import live_log
    from pipeline.robot.recorded import recorded_hands
    from recorders.reading.parts import one_session

    log = one_session(logs)
    topics = pairing.topics(recorded_hands(log, robot=robot, renames=names))
    return live_log(log, robot=robot, epochs=epochs, tick=topics, renames=names)


def _from_logs(
    logs: list[Path],
    robot: "RobotConfig | None",
    learner: "Settings",
    epochs: int | None,
    names: dict[str, str],
    pairing: "PairingRule",
    *,
    as_recorded: bool,
) -> "Source":
    """Return logs as their learner is to be presented them, or a session as it was recorded."""
    from pipeline.robot.recorded import recorded_hands
    from recorders.reading.parts import one_session, recordings
    from replay.sources.scheduled import Replay
    from replay.sources.session import RecordedSession

    found = [one_session(logs)] if as_recorded else recordings(logs)
    topics = pairing.topics(recorded_hands(found[0], robot=robot, renames=names))
    if as_recorded:
        return RecordedSession(found[0], epochs=epochs, renames=names, topics=topics)
    return Replay(found, learner.schedule(epochs, topics), renames=names)
