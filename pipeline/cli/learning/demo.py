"""The verb demo."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import Epochs, Json, Seed
from pipeline.cli.viewers import ViewOptions
from pipeline.terminal import console


@grouped
def demo(
    *,
    out: Annotated[Path, typer.Option(help="Folder for logs, controller, report and summary.", metavar="DIR")] = Path(
        "out/demo"
    ),
    seed: Seed = 0,
    epochs: Epochs = 150,
    duration: Annotated[
        float, typer.Option(help="How long the rule to deploy explores [s].", min=1.0, metavar="SECONDS")
    ] = 120.0,
    viewer: ViewOptions,
    as_json: Json = False,
) -> None:
    """Run the main job end to end.

    Explore, record, replay over Zenoh, learn, check and report. It prints whether its digests are the published ones,
    with exit status 0 either way; 1 is for a learner over Zenoh that differs from the one trained from the file.
    """
    from pipeline.demo.deployables import deployables_table
    from pipeline.demo.run import REPORT, results_table, run_demo
    from pipeline.published import published_line

    with viewer.open() as view:
        result = run_demo(out, seed=seed, epochs=epochs, duration_s=duration, view=view)
    if as_json:
        console.show(result.summary(out), as_json=True)
        return
    console.table(results_table(result))
    console.table(deployables_table(result.deployable, result.self_taught))
    digest, took = result.file_digest[:16], sum(result.seconds.values())
    console.line(published_line(result.digests, result.published))
    console.line(f"State digest {digest}…, over Zenoh and from the file alike. {took:.0f} s. Look at {out / REPORT}")
