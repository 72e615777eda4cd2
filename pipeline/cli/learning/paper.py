"""The verb paper."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Json, Seed
from pipeline.terminal import console


def paper(
    out: Annotated[
        Path, typer.Option(help="Folder for logs, controllers, figures, report and summary.", metavar="DIR")
    ] = Path("out/paper"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="A short run through everything; its numbers mean nothing.")
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Learn on a Dask cluster with the same files, at tcp://HOST:PORT.", metavar="ADDRESS"),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            help="Seeds of the explorations over which learning rules are compared, from --seed on.",
            min=1,
            metavar="N",
        ),
    ] = 1,
    as_json: Json = False,
) -> None:
    """Rerun every figure and number of the paper, beside ours.

    Exit status 1 if a bound does not hold.
    """
    from pipeline.paper.report import write_report
    from pipeline.paper.run import PaperConfig, check_bounds, run_paper
    from pipeline.paper.table import console_table
    from pipeline.training.executors import dask_cluster, local_processes

    config = (PaperConfig.quick if quick else PaperConfig)(seed=seed, compared=seeds)
    executors = local_processes if scheduler is None else partial(dask_cluster, scheduler)
    result = run_paper(out, config=config, executors=executors)
    with console.progress("report") as advance:
        report = write_report(result, out, is_full=config.is_full, progress=advance)
    if as_json:
        console.show(result.summary(), as_json=True)
    else:
        console.table(console_table(result))
        console.line(f"Look at {report}")
    if config.is_full:
        check_bounds(result)
