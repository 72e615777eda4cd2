"""The verb info."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Rule, StreamsRobot
from pipeline.terminal import console
from recorders.errors import CheckFailed
from recorders.text.wording import escape_control, names_text

if TYPE_CHECKING:
    from recorders.reading.parts import Log


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
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw rates, gaps and stamps of its topics over time, as PNG.", metavar="FILE.png"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what is in a log, and whether it is whole.

    Exit status 1 if it is damaged or cut off. Of one that is whole, show also whether it can be trained.
    """
    from pipeline.robot.config import load_robot
    from pipeline.terminal.escaping import wrapped
    from pipeline.terminal.log_tables import clock_lines, damage_lines, overview, topic_lines
    from recorders.reading.parts import Parts, one_session
    from recorders.recovery.session_info import summarise_log

    log = one_session(logs)
    with console.progress("info") as advance:
        summary = summarise_log(log, on_progress=advance)
    parts = {"parts": [str(path) for path in log.paths]} if isinstance(log, Parts) else {}
    training = None
    if summary.sound:
        from pipeline.training.trainability import trainability

        config, alignment = None if robot is None else load_robot(robot), alignment.of_logs([log])
        training = trainability(log, rule=rule, robot=config, alignment=alignment.config(), renames=alignment.renames)
    if as_json:
        found = {"training": None if training is None else training.to_dict()}
        console.show(summary.to_dict() | parts | found, as_json=True)
    else:
        shown = {name: names_text(Path(path).name for path in paths) for name, paths in parts.items()}
        console.entries(overview(summary) | shown)
        console.block("\n".join(topic_lines(summary, console.width())))
        if clocks := list(clock_lines(summary, console.width())):
            console.block("\n".join(clocks))
        if summary.survey.damage:
            console.block("\n".join(damage_lines(summary.survey.damage, console.width())))
            console.line("`reenact recover` writes a sound log with what is whole.")
        if training is not None:
            for line in (*training.alignment, f"can be trained: {training.text()}", *training.notes):
                console.block("\n".join(wrapped(escape_control(line), console.width())))
    if plot is not None and summary.sound:
        _draw(plot, log)
    elif plot is not None:
        console.notice("no picture of a damaged log; `reenact recover` makes one that can be drawn")
    if not summary.sound:
        raise typer.Exit(CheckFailed.exit_status)


def _draw(path: Path, log: "Log") -> None:
    """Draw the times of a recording; raises LogError if it is damaged, ConfigError if there is nothing to draw."""
    from pipeline.views.log_times import draw_log_times
    from recorders.recovery.log_times import read_times

    draw_log_times(path, read_times(log), title=log.name)
