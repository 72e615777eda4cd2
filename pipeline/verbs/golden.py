"""Golden-log regression: make a case, check cases."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.resources import data_path
from pipeline.verbs.options import AsRecorded, Json, Logs
from recorders.errors import CheckFailed

app = typer.Typer(name="golden", help="Golden-log regression.", no_args_is_help=True, rich_markup_mode=None)


@app.command(epilog="Example: reenact golden add eight.mcap --config learner.toml --name eight --dir golden --physics")
def add(
    logs: Logs,
    config: Annotated[Path, typer.Option(help="Settings of the learner, seed included (TOML).")],
    name: Annotated[str, typer.Option(help="Name of the case.")],
    dir_: Annotated[Path, typer.Option("--dir", help="Folder of the cases.")] = Path("golden"),
    epochs: Annotated[int | None, typer.Option(help="Epochs, at most 6; 2, or as recorded.", min=1)] = None,
    as_recorded: AsRecorded = False,
    resume_after: Annotated[
        int | None, typer.Option(help="Stop after so many ticks, and go on from a checkpoint.", min=1)
    ] = None,
    physics: Annotated[bool, typer.Option("--physics", help="Check teacher and simulation, too.")] = False,
    reason: Annotated[str | None, typer.Option(help="Why an existing case changes; kept in its history.")] = None,
    as_json: Json = False,
) -> None:
    """Make a golden case of logs and a learner, or accept a change to one."""
    from pipeline.golden_runner import GoldenRunner, recipe
    from replay.golden_add import add_case
    from replay.golden_case import check_name

    check_name(name)
    made = recipe(logs, config, epochs=epochs, as_recorded=as_recorded, resume_after=resume_after, physics=physics)
    case = add_case(dir_ / name, made, GoldenRunner(), reason=reason)
    size = sum(path.stat().st_size for path in case.folder.iterdir())
    result = {"case": str(case.folder), "bytes": size, "digest": case.expected["digest"]}
    console.show({**result, "errors_cm": case.expected["errors_cm"]}, as_json=as_json)


@app.command(epilog="Example: reenact golden check golden --json")
def check(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of cases, or of one; by default those of the program.", metavar="DIR")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check golden cases against the present program; exit status 1 if one does not hold."""
    from pipeline.golden_runner import GoldenRunner
    from replay.golden import check_all, summary

    with console.progress("golden check") as advance:
        verdicts = list(check_all(folder or data_path("golden"), GoldenRunner(), progress=advance))
    if as_json:
        console.show(summary(verdicts), as_json=True)
    else:
        for verdict in verdicts:
            print(f"{verdict.status}  {verdict.name}" + (f"  {verdict.finding}" if verdict.finding else ""))
    if any(verdict.finding for verdict in verdicts):
        raise typer.Exit(CheckFailed.exit_status)
