"""The verb recover."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Json, Overwrite
from pipeline.terminal import console
from recorders.errors import ConfigError


def recover(
    damaged: Annotated[Path, typer.Argument(help="A damaged or cut-off log; only read.", metavar="DAMAGED")],
    out: Annotated[Path, typer.Option(help="Log to write.", metavar="LOG.mcap")],
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write what is whole in a damaged log to another one.

    The log may be damaged or cut off; the result counts what is recovered and what is lost.
    """
    from pipeline.terminal.log_tables import damage_lines, recovered
    from recorders.recovery.recover import recover as run

    if damaged.is_dir():
        raise ConfigError(f"{damaged}: expected a log, found a folder; the parts of a session are recovered one by one")
    with console.progress("recover") as advance:
        recovery = run(damaged, out, overwrite=overwrite, on_progress=advance)
    if as_json:
        console.show(recovery.to_dict(), as_json=True)
        return
    console.entries(recovered(recovery))
    if recovery.damage:
        console.block("\n".join(damage_lines(recovery.damage, console.width())))
