"""The verb diff."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Json
from pipeline.terminal import console
from recorders.errors import CheckFailed


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
    from pipeline.cli.logs.diff_files import DiffConfig
    from pipeline.cli.logs.diff_files import diff as run

    found = run(a, b, DiffConfig(tuple(topic or ()), tuple(ignore or ()), tolerance))
    if as_json:
        console.show({"equal": found is None, "first_divergence": found and asdict(found)}, as_json=True)
    else:
        console.line("no divergence" if found is None else str(found))
    if found is not None:
        raise typer.Exit(CheckFailed.exit_status)
