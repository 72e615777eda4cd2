"""The verb demonstrate."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.interrupts import note_partial_log
from pipeline.cli.options import Json, Overwrite, Renames, Robot, Seed, renames
from pipeline.cli.project_settings import of_settings
from pipeline.cli.sessions import ListeningSession
from pipeline.motions.names import drawings
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.exploration.demonstration import DemonstrationConfig
    from pipeline.exploration.hand_paths import DemonstratedPaths
    from pipeline.exploration.live_paths import ListenConfig
    from pipeline.robot.config import RobotConfig
    from recorders.wire.keys.topic_keys import TopicKeys


LIVE = "live"


@dataclass(frozen=True)
class PoseOptions:
    """Topics and hands of the demonstrated poses."""

    hand: Annotated[str | None, typer.Option(help="The hand that is shown, such as left.", metavar="HAND")] = None
    topic: Annotated[
        str | None,
        typer.Option(
            help="PoseStamped topic of one hand: of --hand, or of the last, the right; all hands' targets if left out.",
            metavar="TOPIC",
        ),
    ] = None
    map_: Renames = None


@dataclass(frozen=True)
class PathOptions:
    """Placement of the paths in the workspace of the robot."""

    hz: Annotated[float, typer.Option(help="Samples a second.", metavar="HZ")] = 10.0
    align: Annotated[
        str,
        typer.Option(help="Middle of each path: at the `centre` of the workspace, or `as-is`.", metavar="CHOICE"),
    ] = "centre"
    scale: Annotated[
        float, typer.Option(help="Enlarge the paths, or bring another unit to metres.", metavar="FACTOR")
    ] = 1.0
    plane: Annotated[
        str | None,
        typer.Option(
            help="Source axes to the robot's left and up, such as --plane=-x,y for a screen.", metavar="AXIS,AXIS"
        ),
    ] = None
    project_to_plane: Annotated[
        bool, typer.Option("--project-to-plane", help="Flatten the paths into the plane in which the robot draws.")
    ] = False
    on_unreachable: Annotated[
        str,
        typer.Option(help="Samples out of reach: refuse, clip to the nearest point, skip, or keep.", metavar="CHOICE"),
    ] = "refuse"

    smooth: Annotated[
        float,
        typer.Option(
            help="Window of smoothing; longer, or the motion slower, where the robot could not follow. 0 does neither.",
            metavar="SECONDS",
        ),
    ] = 0.3

    def config(self) -> "DemonstrationConfig":
        """Return the settings of the demonstration."""
        from pipeline.exploration.demonstration import DemonstrationConfig

        return DemonstrationConfig(
            self.hz, self.align, self.scale, self._axes(), self.project_to_plane, self.on_unreachable, self.smooth
        )

    def _axes(self) -> tuple[str, str] | None:
        if self.plane is None:
            return None
        left, comma, up = self.plane.partition(",")
        if not comma:
            raise ConfigError(f"--plane: expected two axes, such as --plane=-x,y, found {self.plane!r:.40}")
        return left.strip(), up.strip()


@dataclass(frozen=True)
class LiveOptions:
    """Start and end of a live demonstration."""

    duration: Annotated[
        float | None,
        typer.Option(help="With live: how long it lasts, by the stamps, from the first pose on.", metavar="SECONDS"),
    ] = None
    idle_timeout: Annotated[
        float | None,
        typer.Option(
            help="With live: it is over after so long without a pose, once the first has come; 2 if left out.",
            metavar="SECONDS",
        ),
    ] = None
    wait: Annotated[
        float | None,
        typer.Option(help="With live: how long the first pose may take to come; 60 if left out.", metavar="SECONDS"),
    ] = None

    @property
    def wanted(self) -> bool:
        """True if anything is set that needs a live source."""
        return any(each is not None for each in (self.duration, self.idle_timeout, self.wait))

    def config(self, keys: "TopicKeys") -> "ListenConfig":
        """Return the settings for a subscription."""
        from pipeline.exploration.live_paths import DEFAULT_IDLE_TIMEOUT_S, DEFAULT_WAIT_S, ListenConfig

        return ListenConfig(
            duration_s=math.inf if self.duration is None else self.duration,
            idle_timeout_s=DEFAULT_IDLE_TIMEOUT_S if self.idle_timeout is None else self.idle_timeout,
            wait_s=DEFAULT_WAIT_S if self.wait is None else self.wait,
            keys=keys,
        )


@grouped
def demonstrate(
    source: Annotated[
        str,
        typer.Argument(
            help=f"A CSV file, a log, one of {', '.join(drawings())}, or `live` for a pose topic over Zenoh.",
            metavar="MOTION.csv|LOG.mcap|live",
            autocompletion=lambda incomplete: [name for name in (*drawings(), LIVE) if name.startswith(incomplete)],
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Log to write.", metavar="LOG.mcap")],
    pose: PoseOptions,
    path: PathOptions,
    live: LiveOptions,
    robot: Robot = "asimo",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    session: ListeningSession,
    as_json: Json = False,
) -> None:
    """Make an episode of what somebody showed.

    Teacher and simulated robot follow it, and the log is written; Ctrl-C ends what is shown live. Of a hand whose pose
    is controlled the orientation is followed too, where it is shown: in the columns NAME_qx to NAME_qw, or in poses.
    """
    from pipeline.exploration.demonstration import demonstrate as run
    from pipeline.exploration.demonstration import turned_hands
    from pipeline.robot.config import load_robot
    from recorders.writing.part_file import check_place

    config = path.config()
    follower = load_robot(robot)
    hands = follower.hand_names
    if pose.hand is not None and pose.hand not in hands:
        raise ConfigError(f"--hand: expected {' or '.join(hands)}, found {pose.hand!r:.40}")
    if pose.topic is not None and pose.hand is None and len(hands) > 1:
        others = "the other" if len(hands) == 2 else "another"
        console.notice(f"--topic: {pose.topic} is taken for the {hands[-1]} hand; --hand {hands[0]} for {others}")
    check_place(out, overwrite=overwrite)
    shown = _subscribe(hands, pose, live, session) if source == LIVE else _read(source, follower, pose, live, session)
    turned = turned_hands(follower, shown)
    if still := [hand.name for hand in follower.hands if hand.orientation is not None and hand.name not in turned]:
        keeps = "keeps" if len(still) == 1 else "keep"
        console.notice(f"no orientation is shown: {' and '.join(still)} {keeps} that of the middle")
    with note_partial_log(out), console.progress(f"demonstrate {shown.name}") as advance:
        result = run(
            follower,
            shown,
            config=config,
            seed=seed,
            out=out,
            overwrite=overwrite,
            progress=advance,
        )
    console.show(result.to_dict(), as_json=as_json)


def _read(
    source: str, robot: "RobotConfig", pose: PoseOptions, live: LiveOptions, session: ListeningSession
) -> "DemonstratedPaths":
    from pipeline.exploration.hand_paths import pose_topics, read_csv_paths, read_log_paths
    from recorders.reading.parts import is_log, one_session

    in_ros = session.ros is not None and not of_settings("ros")
    renamed = (session.remap and not of_settings("remap")) or (session.humble and not of_settings("humble"))
    if session.listen or session.connect or session.zenoh_config or in_ros or renamed or live.wanted:
        raise ConfigError(
            "--listen, --connect, --zenoh-config, --ros, --remap, --humble, --duration, --idle-timeout and --wait: "
            f"expected the source {LIVE} beside them, found {source!r:.80}"
        )
    path, hands = drawings().get(source, Path(source)), robot.hand_names
    if is_log(path):
        topics = pose_topics(pose.topic, hands, hand=pose.hand)
        return read_log_paths(one_session([path]), topics, renames=renames(pose.map_))
    if pose.topic or pose.map_:
        raise ConfigError(f"--topic and --map: expected a log or the source {LIVE}, found {source!r:.80}")
    posed = [hand.name for hand in robot.hands if hand.orientation is not None]
    return read_csv_paths(path, hands, hand=pose.hand, posed=posed)


def _subscribe(
    hands: Sequence[str], pose: PoseOptions, live: LiveOptions, session: ListeningSession
) -> "DemonstratedPaths":
    from pipeline.exploration.hand_paths import pose_topics
    from pipeline.exploration.live_paths import subscribe_paths
    from pipeline.terminal.signals import until_stopped

    config = live.config(session.keys("demonstration"))
    where = session.config()
    with until_stopped() as stopped:
        return subscribe_paths(
            pose_topics(pose.topic, hands, hand=pose.hand),
            renames=renames(pose.map_),
            session=where,
            config=config,
            stopped=stopped,
        )
