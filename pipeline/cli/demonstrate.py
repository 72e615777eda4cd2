"""The verb demonstrate: what somebody showed becomes an episode."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.interrupts import leaving_log
from pipeline.cli.options import (
    ConnectInstead,
    Json,
    ListenFirst,
    Namespace,
    Overwrite,
    Renames,
    Robot,
    Seed,
    ZenohConfig,
    renames,
    session_config,
)
from pipeline.motions.names import drawings
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.exploration.hand_paths import Shown
    from pipeline.exploration.live_paths import ListenConfig

LIVE = "live"


def demonstrate(
    source: Annotated[
        str,
        typer.Argument(
            help=f"A CSV file, a log, one of {', '.join(drawings())}, or `live` for a pose topic over Zenoh.",
            metavar="MOTION.csv|LOG.mcap|live",
            autocompletion=lambda incomplete: [name for name in (*drawings(), LIVE) if name.startswith(incomplete)],
        ),
    ],
    out: Annotated[Path, typer.Option(help="Log to write.", metavar="LOG.mcap")],
    hand: Annotated[str | None, typer.Option(help="The hand that is shown: left or right.", metavar="HAND")] = None,
    topic: Annotated[
        str | None,
        typer.Option(
            help="PoseStamped topic of one hand: of the right, or of --hand; both hands' targets if left out.",
            metavar="TOPIC",
        ),
    ] = None,
    map_: Renames = None,
    hz: Annotated[float, typer.Option(help="Samples a second.", metavar="HZ")] = 10.0,
    place: Annotated[
        str,
        typer.Option(help="Middle of each path: at the `centre` of the workspace, or `as-is`.", metavar="PLACE"),
    ] = "centre",
    scale: Annotated[
        float, typer.Option(help="Enlarge the paths, or bring another unit to metres.", metavar="FACTOR")
    ] = 1.0,
    plane: Annotated[
        str | None,
        typer.Option(
            help="Source axes to the robot's left and up, such as --plane=-x,y for a screen.", metavar="AXIS,AXIS"
        ),
    ] = None,
    flat: Annotated[bool, typer.Option("--flat", help="Flatten the paths into the plane in which the robot draws.")] = (
        False
    ),
    unreachable: Annotated[
        str,
        typer.Option(help="Samples out of reach: refuse, clip to the nearest point, skip, or keep.", metavar="CHOICE"),
    ] = "refuse",
    duration: Annotated[
        float | None,
        typer.Option(help="With live: how long it lasts, by the stamps, from the first pose on.", metavar="SECONDS"),
    ] = None,
    silence: Annotated[
        float | None,
        typer.Option(
            help="With live: it is over after so long without a pose, once the first has come; 2 if left out.",
            metavar="SECONDS",
        ),
    ] = None,
    wait: Annotated[
        float | None,
        typer.Option(help="With live: how long the first pose may take to come; 60 if left out.", metavar="SECONDS"),
    ] = None,
    robot: Robot = "asimo",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    listen: ListenFirst = None,
    connect: ConnectInstead = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    as_json: Json = False,
) -> None:
    """Make an episode of what somebody showed.

    Teacher and simulated robot follow it, and the log is written; Ctrl-C ends what is shown live.
    """
    from pipeline.exploration.demonstration import DemonstrationConfig
    from pipeline.exploration.demonstration import demonstrate as run
    from pipeline.exploration.live_paths import DEFAULT_SILENCE_S, DEFAULT_WAIT_S, ListenConfig
    from pipeline.robot.config import load_robot
    from recorders.writing.part_file import check_place

    if hand not in (None, "left", "right"):
        raise ConfigError(f"--hand: expected left or right, found {hand!r:.40}")
    if topic is not None and hand is None:
        console.say(f"--topic: {topic} is taken for the right hand; --hand left for the other")
    config = DemonstrationConfig(hz, place, scale, _axes(plane), flat, unreachable)
    follower = load_robot(robot)
    check_place(out, overwrite=overwrite)
    if source == LIVE:
        listening = ListenConfig(
            duration_s=math.inf if duration is None else duration,
            silence_s=DEFAULT_SILENCE_S if silence is None else silence,
            wait_s=DEFAULT_WAIT_S if wait is None else wait,
            namespace=namespace,
        )
        shown = _hear(listening, hand, topic, map_, listen, connect, zenoh_config)
    else:
        if listen or connect or zenoh_config or any(each is not None for each in (duration, silence, wait)):
            raise ConfigError(
                f"--listen, --connect, --zenoh-config, --duration, --silence and --wait: expected the source {LIVE} "
                f"beside them, found {source!r:.80}"
            )
        shown = _read(source, hand, topic, map_)
    with leaving_log(out), console.progress(f"demonstrate {shown.name}") as advance:
        result = run(
            follower,
            shown,
            config=config,
            seed=seed,
            out=out,
            overwrite=overwrite,
            progress=advance,
            say=console.say,
        )
    console.show(result.to_dict(), as_json=as_json)


def _axes(plane: str | None) -> tuple[str, str] | None:
    if plane is None:
        return None
    left, comma, up = plane.partition(",")
    if not comma:
        raise ConfigError(f"--plane: expected two axes, such as --plane=-x,y, found {plane!r:.40}")
    return left.strip(), up.strip()


def _read(source: str, hand: str | None, topic: str | None, map_: list[str] | None) -> "Shown":
    from pipeline.exploration.hand_paths import pose_topics, read_csv_paths, read_log_paths
    from recorders.reading.parts import is_log, one_session

    path = drawings().get(source, Path(source))
    if is_log(path):
        return read_log_paths(one_session([path], console.say), pose_topics(topic, hand=hand), renames=renames(map_))
    if topic or map_:
        raise ConfigError(f"--topic and --map: expected a log or the source {LIVE}, found {source!r:.80}")
    return read_csv_paths(path, hand=hand)


def _hear(
    listening: "ListenConfig",
    hand: str | None,
    topic: str | None,
    map_: list[str] | None,
    listen: list[str] | None,
    connect: list[str] | None,
    zenoh_config: Path | None,
) -> "Shown":
    from pipeline.exploration.hand_paths import pose_topics
    from pipeline.exploration.live_paths import hear_paths
    from pipeline.terminal.signals import until_stopped

    session = session_config(listen, connect, zenoh_config, listens=True)
    with until_stopped() as stopped:
        return hear_paths(
            pose_topics(topic, hand=hand),
            renames=renames(map_),
            session=session,
            config=listening,
            stopped=stopped,
            say=console.say,
        )
