"""The verb info."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Rule, StreamsRobot
from pipeline.terminal import console
from recorders.errors import CheckFailed
from recorders.text.wording import names_text


@grouped
def info(
    logs: Annotated[
        list[Path],
        typer.Argument(help="A log or a bag, finished or not, or the parts of a session.", metavar="LOG.mcap"),
    ],
    *,
    robot: StreamsRobot = None,
    rule: Rule = None,
    alignment: AlignmentOptions,
    as_json: Json = False,
) -> None:
    """Show what is in a log, and whether it is whole.

    Exit status 1 if it is damaged or cut off. Of one that is whole, show also whether it can be trained.
    """
    from pipeline.robot.config import load_robot
    from pipeline.terminal.log_tables import damage_lines, overview, topic_lines
    from recorders.reading.parts import Parts, one_session
    from recorders.recovery.session_info import summarise_log

    log = one_session(logs)
    with console.progress("info") as advance:
        summary = summarise_log(log, on_progress=advance)
    parts = {"parts": [str(path) for path in log.paths]} if isinstance(log, Parts) else {}
    training = None
    if summary.sound:
        from pipeline.training.trainability import trainability

        config = None if robot is None else load_robot(robot)
        training = trainability(log, rule=rule, robot=config, alignment=alignment.config(), renames=alignment.renames)
    if as_json:
        found = {"training": None if training is None else training.to_dict()}
        console.show(summary.to_dict() | parts | found, as_json=True)
    else:
        shown = {name: names_text(Path(path).name for path in paths) for name, paths in parts.items()}
        console.entries(overview(summary) | shown)
        console.block("\n".join(topic_lines(summary, console.width())))
        if summary.survey.damage:
            console.block("\n".join(damage_lines(summary.survey.damage, console.width())))
            console.line("`reenact recover` writes a sound log with what is whole.")
        if training is not None:
            for line in training.alignment:
                console.line(line)
            console.line(f"can be trained: {training.text()}")
            for line in training.notes:
                console.line(line)
    if not summary.sound:
        raise typer.Exit(CheckFailed.exit_status)
