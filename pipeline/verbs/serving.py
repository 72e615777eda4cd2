"""The verb `serve`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline import console
from pipeline.verbs.options import (
    ConnectInstead,
    Controller,
    Json,
    ListenFirst,
    Namespace,
    Overwrite,
    ZenohConfig,
    session_config,
)
from pipeline.verbs.stopping import words
from pipeline.verbs.viewing import View, Viewer, answers_shown

if TYPE_CHECKING:
    from pipeline.controller import Controller as Learned


def serve(
    controller: Controller,
    name: Annotated[
        str, typer.Option(help="Name in the keys of liveliness token and status.", metavar="NAME")
    ] = "controller",
    learn: Annotated[bool, typer.Option("--learn", help="Go on learning; needs /sample/joint_states.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Controller to write at the end, as it is then.", metavar="CONTROLLER.npz")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="Log to write: answered targets, and commands.", metavar="LOG.mcap")
    ] = None,
    beside_others: Annotated[
        bool, typer.Option("--beside-others", help="Serve although another controller does, in the same namespace.")
    ] = False,
    listen: ListenFirst = None,
    connect: ConnectInstead = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    overwrite: Overwrite = False,
    view: View = False,
    viewer: Viewer = None,
    as_json: Json = False,
) -> None:
    """Answer hand targets with joint commands over Zenoh.

    Ctrl-C or SIGTERM ends it; then the last status is printed.
    """
    from pipeline.controller import Controller as Learned
    from pipeline.controller import check_writable
    from pipeline.serve_node import ServeConfig
    from pipeline.serve_node import serve as run
    from pipeline.serving import ServingConfig
    from recorders.wire.session import read_as_it_comes

    told = False

    def end(status: dict[str, Any], served: "Learned") -> None:
        nonlocal told
        if out is not None:
            served.save(out)
        console.show(status, as_json=as_json)
        told = True

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
    if not session.listen:
        read_as_it_comes()
    loaded = Learned.load(controller)
    try:
        with answers_shown(view, viewer, loaded, title=f"{name} serves") as on_command:
            run(loaded, session=session, config=config, say=console.say, on_end=end, on_command=on_command)
    except (KeyboardInterrupt, SystemExit) as stop:
        if not told:
            raise
        raise typer.Exit(words(stop)[1]) from stop  # its status says it all
