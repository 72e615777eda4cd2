"""The verb `serve`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline import console
from pipeline.verbs.options import (
    Connect,
    Controller,
    Json,
    Listen,
    Namespace,
    Overwrite,
    ZenohConfig,
    session_config,
)
from pipeline.verbs.viewing import View, Viewer, answers_shown

if TYPE_CHECKING:
    from pipeline.controller import Controller as Learned


def serve(
    controller: Controller,
    name: Annotated[str, typer.Option(help="Name in the keys of liveliness token and status.")] = "controller",
    learn: Annotated[bool, typer.Option("--learn", help="Go on learning; needs /sample/joint_states.")] = False,
    out: Annotated[Path | None, typer.Option(help="Controller to write at the end, as it is then.")] = None,
    record: Annotated[Path | None, typer.Option(help="Log to write: answered targets, and commands.")] = None,
    beside_others: Annotated[
        bool, typer.Option("--beside-others", help="Serve although another controller does, in the same namespace.")
    ] = False,
    listen: Listen = None,
    connect: Connect = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    overwrite: Overwrite = False,
    view: View = False,
    viewer: Viewer = None,
    as_json: Json = False,
) -> None:
    """Answer hand targets with joint commands over Zenoh, until Ctrl-C or SIGTERM; then print the last status."""
    from pipeline.controller import Controller as Learned
    from pipeline.controller import check_writable
    from pipeline.serve_node import ServeConfig
    from pipeline.serve_node import serve as run
    from pipeline.serving import ServingConfig

    def end(status: dict[str, Any], served: "Learned") -> None:
        if out is not None:
            served.save(out)
        console.show(status, as_json=as_json)

    if out is not None:
        check_writable(out)
    config = ServeConfig(
        name=name,
        namespace=namespace,
        serving=ServingConfig(learn=learn),
        record=record,
        overwrite=overwrite,
        beside_others=beside_others,
    )
    session = session_config(listen, connect, zenoh_config, listens=True)
    loaded = Learned.load(controller)
    with answers_shown(view, viewer, loaded, title=f"{name} serves") as on_command:
        run(loaded, session=session, config=config, say=console.say, on_end=end, on_command=on_command)
