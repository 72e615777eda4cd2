"""The verbs explore and robot: a teacher and a robot make an episode, in one process or in two."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.interrupts import leaving_log
from pipeline.cli.options import (
    MOTIONS,
    Await,
    ConnectInstead,
    Json,
    ListenFirst,
    Namespace,
    Overwrite,
    Prometheus,
    Robot,
    Seed,
    Wait,
    ZenohConfig,
    complete_motion,
    session_config,
)
from pipeline.cli.view import View, Viewer, robot_shown
from pipeline.terminal import console
from recorders.errors import ConfigError

_ROBOT, _NAMESPACE, _WAIT_S = "asimo", "reenact", 10.0


def explore(
    motion: Annotated[
        str,
        typer.Option(
            help=f"One of {MOTIONS}, or a CSV file with t,lx,ly,lz,rx,ry,rz [s, m].",
            metavar="MOTION",
            autocompletion=complete_motion,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Log to write, unless a running robot is driven.", metavar="LOG.mcap")
    ] = None,
    robot: Robot = _ROBOT,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    connect: Annotated[
        list[str] | None,
        typer.Option(help="Drive the robot that runs there, in place of one of our own.", metavar="ENDPOINT"),
    ] = None,
    awaited: Await = None,
    epochs: Annotated[int, typer.Option(help="With --connect: epochs of the live session.", min=1, metavar="N")] = 1,
    wait: Wait = _WAIT_S,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = _NAMESPACE,
    view: View = False,
    viewer: Viewer = None,
    as_json: Json = False,
) -> None:
    """Let the teacher lead a robot through a motion.

    A simulated robot makes a log; one that runs already is driven live.
    """
    if connect or zenoh_config:
        if view or viewer is not None:
            raise ConfigError("--view: a robot that runs is shown by `reenact learn --view`; leave --view away")
        if out is not None:
            raise ConfigError("--out: a live session is recorded with `reenact record`; leave --out away")
        if robot != _ROBOT or overwrite:
            raise ConfigError("--robot and --overwrite: expected --out beside them, and no robot that runs already")
        result = _drive(motion, connect, zenoh_config, seed, epochs, awaited, wait, namespace)
        console.show(result, as_json=as_json)
        return
    if out is None:
        raise ConfigError("expected --out LOG.mcap, or --connect ENDPOINT to drive a running robot, found neither")
    if awaited or epochs != 1 or wait != _WAIT_S or namespace != _NAMESPACE:
        raise ConfigError("--await, --epochs, --wait and --namespace: expected --connect beside them")
    from pipeline.exploration.explore import explore as run
    from pipeline.motions.motion import load_motion
    from pipeline.robot.config import load_robot
    from recorders.writing.part_file import check_place

    check_place(out, overwrite=overwrite)
    config = load_robot(robot)
    with (
        leaving_log(out),
        console.progress(f"explore {Path(motion).stem}") as advance,
        robot_shown(view, viewer, config, title=f"explore {Path(motion).stem}") as on_message,
    ):
        summary = run(
            config,
            load_motion(motion, config),
            seed=seed,
            out=out,
            overwrite=overwrite,
            progress=advance,
            on_message=on_message,
            say=console.say,
        )
    console.show(asdict(summary) | {"path": str(summary.path)}, as_json=as_json)


def robot(
    robot: Robot = _ROBOT,
    rate: Annotated[float, typer.Option(help="How often it says its state, in its own time.", metavar="HZ")] = 50.0,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Run with the clock on the wall, not as fast as the driver goes.")
    ] = False,
    listen: ListenFirst = None,
    connect: ConnectInstead = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    prometheus: Prometheus = None,
) -> None:
    """Simulate a robot that follows joint commands over Zenoh.

    It stands there until it is stopped, with Ctrl-C or SIGTERM.
    """
    from pipeline.robot.config import load_robot
    from pipeline.robot_node.follower import FollowerConfig
    from pipeline.robot_node.node import run_robot
    from recorders.nodes.metrics import check_metrics

    check_metrics(prometheus)
    config = load_robot(robot)
    following = FollowerConfig(rate_hz=rate, real_time=real_time)
    session = session_config(listen, connect, zenoh_config, listens=True)
    run_robot(config, session=session, namespace=namespace, config=following, metrics_port=prometheus, say=console.say)


def _drive(
    motion: str,
    connect: list[str] | None,
    zenoh_config: Path | None,
    seed: int,
    epochs: int,
    awaited: list[str] | None,
    wait_s: float,
    namespace: str,
) -> dict[str, Any]:
    from pipeline.exploration.live import explore_live
    from replay.sources.schedule import Schedule
    from replay.transports.sender_config import SenderConfig

    sender = SenderConfig(consumers=tuple(awaited or ()), namespace=namespace, batch=1, wait_s=wait_s)
    with console.progress(f"explore {Path(motion).stem}") as advance:
        live = explore_live(
            motion,
            seed=seed,
            schedule=Schedule(epochs=epochs),
            session=session_config(None, connect, zenoh_config, listens=False, wait_s=wait_s),
            sender=sender,
            progress=advance,
            say=console.say,
        )
    return asdict(live)
