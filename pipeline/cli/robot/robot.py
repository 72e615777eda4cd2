"""The verb robot."""

from typing import Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import Robot
from pipeline.cli.sessions import ListeningNode


@grouped
def robot(
    *,
    robot: Robot = "asimo",
    rate: Annotated[
        float, typer.Option(help="How often it publishes its state, in its own time.", metavar="HZ")
    ] = 50.0,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Run with the clock on the wall, not as fast as the driver goes.")
    ] = False,
    node: ListeningNode,
) -> None:
    """Simulate a robot that follows joint commands over Zenoh.

    It stands there until it is stopped, with Ctrl-C or SIGTERM.
    """
    from pipeline.robot.config import load_robot
    from pipeline.robot_node.follower import FollowerConfig
    from pipeline.robot_node.node import run_robot
    from recorders.nodes.metrics import check_metrics

    check_metrics(node.prometheus)
    config = load_robot(robot)
    following = FollowerConfig(rate_hz=rate, real_time=real_time)
    run_robot(
        config,
        session=node.config(),
        namespace=node.namespace,
        config=following,
        metrics_port=node.prometheus,
    )
