"""The verb serve."""

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.interrupts import exit_line
from pipeline.cli.options import Controller, Json, Overwrite
from pipeline.cli.ros_domain import UseSimTime
from pipeline.cli.sessions import ListeningNode
from pipeline.cli.viewers import ViewOptions
from pipeline.terminal import console
from recorders.errors import LearningError

if TYPE_CHECKING:
    from pipeline.learner.controller import Controller as Learned
    from pipeline.serving.node_config import ServeConfig


@dataclass(frozen=True)
class ServeOptions:
    """Name, learning and files of a served controller."""

    name: Annotated[str, typer.Option(help="Name in the keys of liveliness token and status.", metavar="NAME")] = (
        "controller"
    )
    learn: Annotated[
        bool,
        typer.Option("--learn", help="Go on learning, from /sample/joint_states and targets, or hands as measured."),
    ] = False
    out: Annotated[
        Path | None, typer.Option(help="Controller to write at the end, as it is then.", metavar="CONTROLLER.npz")
    ] = None
    record: Annotated[
        Path | None, typer.Option(help="Log to write: answered targets, and commands.", metavar="LOG.mcap")
    ] = None
    refuse_beyond: Annotated[
        bool,
        typer.Option("--refuse-beyond", help="Refuse targets beyond what the controller has explored, if it knows."),
    ] = False
    max_speed: Annotated[
        float | None,
        typer.Option(
            help="Move no joint faster [rad/s, m/s], nor than its own limit; start from /joint_states.",
            metavar="SPEED",
        ),
    ] = None
    command_type: Annotated[
        str,
        typer.Option(help="Commands as joint-state, trajectory or float64-array (ros2_control's).", metavar="TYPE"),
    ] = "joint-state"
    command_topic: Annotated[
        str, typer.Option(help="Topic of the commands; that of their type if left out.", metavar="TOPIC")
    ] = ""
    reach_in: Annotated[
        float | None, typer.Option(help="Time to reach the point of a trajectory in [s]; 0.1 s.", metavar="S")
    ] = None
    allow_multiple: Annotated[
        bool, typer.Option("--allow-multiple", help="Serve although another controller does, in the same namespace.")
    ] = False

    use_sim_time: UseSimTime = False

    def config(self, node: ListeningNode, alignment: AlignmentOptions, *, overwrite: bool) -> "ServeConfig":
        """Return the settings of the node."""
        from pipeline.serving.config import ServingConfig
        from pipeline.serving.node_config import ServeConfig
        from pipeline.serving.output.command_types import CommandFormat

        return ServeConfig(
            name=self.name,
            keys=node.keys(self.name),
            serving=ServingConfig(
                learn=self.learn,
                refuse_beyond=self.refuse_beyond,
                max_speed=self.max_speed,
                commands=CommandFormat(self.command_type, self.command_topic, self.reach_in),
            ),
            record=self.record,
            overwrite=overwrite,
            allow_multiple=self.allow_multiple,
            metrics_port=node.prometheus,
            alignment=alignment.live_config(),
            renames=alignment.renames,
            use_sim_time=self.use_sim_time,
        )


@grouped
def serve(
    controller: Controller,
    *,
    options: ServeOptions,
    alignment: AlignmentOptions,
    node: ListeningNode,
    overwrite: Overwrite = False,
    viewer: ViewOptions,
    as_json: Json = False,
) -> None:
    """Answer hand targets with joint commands over Zenoh.

    Ctrl-C or SIGTERM ends it; then the last status is printed. With --ros it is a node that has topics alone: neither
    parameters nor services nor a lifecycle, in whose place are these options.
    """
    from pipeline.learner.controller import Controller as Learned
    from pipeline.learner.controller import check_writable
    from pipeline.serving.node import serve as run
    from recorders.nodes.metrics import check_metrics
    from recorders.wire.session import single_network_thread

    last: dict[str, Any] = {}  # the last status

    def end(status: dict[str, Any], served: "Learned") -> None:
        """Save the controller and print the last status."""
        if options.out is not None and (status["learned_steps"] or not options.learn):
            served.save(options.out)
        shown = status if as_json else {name: value for name, value in status.items() if name != _LATE_RATE}
        console.show(shown, as_json=as_json)
        last.update(status)

    check_metrics(node.prometheus)
    if options.out is not None:
        check_writable(options.out, overwrite=overwrite)
    config = options.config(node, alignment, overwrite=overwrite)
    session = node.config()
    loaded = Learned.load(controller)
    try:
        with (
            viewer.commands(loaded, title=f"{options.name} serves") as on_command,
            nullcontext() if session.listen else single_network_thread(),
        ):
            run(loaded, session=session, config=config, on_end=end, on_command=on_command)
    except (KeyboardInterrupt, SystemExit) as stop:
        if not last:
            raise
        if options.learn:
            _check_learned(last, loaded.pairs)
        raise typer.Exit(exit_line(stop)[1]) from stop  # its status is the message


_LATE_RATE = "rate_hz"  # of the last two seconds: in those before the end there may have been no targets


def _check_learned(status: dict[str, Any], pairs: str) -> None:
    """Raise LearningError if a controller that was to go on learning did not: what it was stays where it is."""
    from pipeline.samples.pairing import COMMANDED

    if status["learned_steps"]:
        return
    hands = "targets" if pairs == COMMANDED else "hands as measured"
    refused = f", refused {sum(status['refused'].values())}" if status["refused"] else ""
    last = f"; the last: {status['last_refusal']}" if status["last_refusal"] else ""
    raise LearningError(
        f"nothing was learned, and no controller written: --learn: expected {hands} and joints of one stamp, tick "
        f"after tick, found {status['accepted']} ticks answered{refused}{last}"
    )
