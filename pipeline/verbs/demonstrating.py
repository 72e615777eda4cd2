"""The verb demonstrate: what somebody showed becomes an episode."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.verbs.options import (
    Connect,
    Json,
    Listen,
    Namespace,
    Overwrite,
    Renames,
    Robot,
    Seed,
    ZenohConfig,
    renames,
    session_config,
)
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.hand_paths import Shown
    from pipeline.live_paths import ListenConfig

LIVE = "live"


def demonstrate(
    source: Annotated[
        str,
        typer.Argument(
            help="A CSV file, a log, a drawing that comes with the program, or `live` for a pose topic over Zenoh.",
            metavar="MOTION.csv|LOG.mcap|live",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Log to write.")],
    hand: Annotated[str | None, typer.Option(help="The hand that is shown: left or right.")] = None,
    topic: Annotated[
        str | None, typer.Option(help="PoseStamped topic of that hand; both hands' targets if left out.")
    ] = None,
    map_: Renames = None,
    hz: Annotated[float, typer.Option(help="Samples a second.")] = 10.0,
    place: Annotated[str, typer.Option(help="Middle of each path: at the `centre` of the workspace, or `as-is`.")] = (
        "centre"
    ),
    scale: Annotated[float, typer.Option(help="Enlarge the paths, or bring another unit to metres.")] = 1.0,
    plane: Annotated[
        str | None, typer.Option(help="Source axes to the robot's left and up, such as --plane=-x,y for a screen.")
    ] = None,
    flat: Annotated[bool, typer.Option("--flat", help="Flatten the paths into the plane in which the robot draws.")] = (
        False
    ),
    unreachable: Annotated[
        str, typer.Option(help="Samples out of reach: refuse, clip to the nearest point, skip, or keep.")
    ] = "refuse",
    duration: Annotated[
        float | None, typer.Option(help="With live: seconds, by the stamps, after which it is over.")
    ] = None,
    silence: Annotated[
        float | None, typer.Option(help="With live: seconds without a pose after which it is over; 2 if left out.")
    ] = None,
    robot: Robot = "asimo",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    listen: Listen = None,
    connect: Connect = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    as_json: Json = False,
) -> None:
    """Let teacher and simulated robot follow what somebody showed, and write the episode; Ctrl-C ends a live one."""
    from pipeline.demonstration import DemonstrationConfig
    from pipeline.demonstration import demonstrate as run
    from pipeline.live_paths import DEFAULT_SILENCE_S, ListenConfig
    from pipeline.robot import load_robot

    if hand not in (None, "left", "right"):
        raise ConfigError(f"--hand: expected left or right, found {hand!r:.40}")
    config = DemonstrationConfig(hz, place, scale, _axes(plane), flat, unreachable)
    follower = load_robot(robot)
    _check_out(out, overwrite=overwrite)
    if source == LIVE:
        listening = ListenConfig(
            math.inf if duration is None else duration, DEFAULT_SILENCE_S if silence is None else silence, namespace
        )
        shown = _hear(listening, hand, topic, map_, listen, connect, zenoh_config)
    else:
        if listen or connect or zenoh_config or duration is not None or silence is not None:
            raise ConfigError(
                f"--listen, --connect, --zenoh-config, --duration and --silence: expected the source {LIVE} "
                f"beside them, found {source!r:.80}"
            )
        shown = _read(source, hand, topic, map_)
    with console.progress(f"demonstrate {shown.name}") as advance:
        result = run(follower, shown, config=config, seed=seed, out=out, overwrite=overwrite, progress=advance)
    console.show(result.to_dict(), as_json=as_json)


def _check_out(out: Path, *, overwrite: bool) -> None:
    """Check where the log goes, before anybody shows anything."""
    if not out.absolute().parent.is_dir():
        raise ConfigError(f"--out: expected a folder {out.parent}, found none")
    if out.exists() and not overwrite:
        raise ConfigError(f"{out} exists: choose another --out, or replace it with --overwrite")


def _axes(plane: str | None) -> tuple[str, str] | None:
    if plane is None:
        return None
    left, comma, up = plane.partition(",")
    if not comma:
        raise ConfigError(f"--plane: expected two axes, such as --plane=-x,y, found {plane!r:.40}")
    return left.strip(), up.strip()


def _read(source: str, hand: str | None, topic: str | None, map_: list[str] | None) -> "Shown":
    from pipeline.hand_paths import pose_topics, read_csv_paths, read_log_paths
    from pipeline.resources import data_path

    drawing = data_path("motions", f"{source}.csv")
    path = drawing if drawing.is_file() else Path(source)
    if path.suffix == ".mcap":
        return read_log_paths(path, pose_topics(topic, hand=hand), renames=renames(map_))
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
    from pipeline.hand_paths import pose_topics
    from pipeline.live_paths import hear_paths
    from pipeline.signals import until_stopped

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
