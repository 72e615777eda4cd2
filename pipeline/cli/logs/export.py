"""The verb export."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Json
from pipeline.terminal import console


def export(
    log: Annotated[Path, typer.Argument(help="A recording of any kind.", metavar="RECORDING")],
    out: Annotated[Path, typer.Option(help="Folder to make, with a file for each topic.", metavar="FOLDER")],
    form: Annotated[str, typer.Option("--format", help="csv or parquet.", metavar="FORMAT")] = "csv",
    topic: Annotated[
        list[str] | None,
        typer.Option(help="Pattern of topics to write, such as '/hand/*'; all if left out.", metavar="PATTERN"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a recording as tables, a file for each topic.

    A message is a row, with a column for each number or text in it; joints have columns by their names. Topics that
    cannot be decoded are named and left out.
    """
    from recorders.export.export import export as run
    from recorders.reading.parts import one_session

    result = run(one_session([log]), out, form=form, topics=topic or ())
    for name, why in result.unreadable.items():
        console.notice(f"left out: {name}: {why}")
    if as_json:
        console.show(result.to_dict(), as_json=True)
    else:
        console.entries({name: f"{result.rows[name]} rows in {path}" for name, path in result.files.items()})
