"""The verb robot: a simulated robot as a node, and the verbs about robots' folders."""

from typing import Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import Robot
from pipeline.cli.robot.folders import check, new
from pipeline.cli.sessions import ListeningNode
from pipeline.cli.usage import VerbGroup, Verbs, refuse_options

app = Verbs(name="robot", cls=VerbGroup, rich_markup_mode=None)


@app.callback(
    invoke_without_command=True,
    epilog="Example: reenact robot\n\n"
    "Then, in a second terminal: reenact explore --connect tcp/127.0.0.1:7447 --motion eight",
)
@grouped
def robot(
    ctx: typer.Context,
    *,
    robot: Robot = "asimo",
    rate: Annotated[
        float, typer.Option(help="How often it publishes its state, in its own time.", metavar="HZ")
    ] = 50.0,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Run with the clock on the wall, not as fast as the driver goes.")
    ] = False,
    joint_offset: Annotated[
        int | None,
        typer.Option(help="Seed of wrongly zeroed joints: sensors and motors are off alike.", metavar="SEED", min=0),
    ] = None,
    offset_rad: Annotated[
        float,
        typer.Option(help="Largest offset of a joint with --joint-offset; the least is 60 % of it.", metavar="RAD"),
    ] = 0.05,
    node: ListeningNode,
) -> None:
    """Simulate a robot that follows joint commands over Zenoh.

    It stands there until it is stopped, with Ctrl-C or SIGTERM. `new` and `check` simulate nothing.
    """
    if ctx.invoked_subcommand is not None:
        refuse_options(ctx)
        return
    from pipeline.robot.config import load_robot
    from pipeline.robot_node.follower import FollowerConfig
    from pipeline.robot_node.node import run_robot
    from pipeline.simulation.joint_offset import joint_offsets
    from recorders.nodes.metrics import check_metrics

    check_metrics(node.prometheus)
    config = load_robot(robot)
    offsets = None if joint_offset is None else joint_offsets(joint_offset, len(config.joints), largest=offset_rad)
    following = FollowerConfig(rate_hz=rate, real_time=real_time)
    run_robot(
        config,
        session=node.config(),
        keys=node.keys(config.name),
        config=following,
        metrics_port=node.prometheus,
        joint_offsets=offsets,
    )


app.command(epilog="Example: reenact robot new panda.urdf --hand panda_hand_tcp --out panda")(new)
app.command(epilog="Example: reenact robot check panda")(check)
