"""The verb explore."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.interrupts import note_partial_log
from pipeline.cli.options import MOTIONS, Json, Overwrite, Robot, Seed, complete_motion
from pipeline.cli.project_settings import of_settings
from pipeline.cli.ros_domain import Humble, Remap, RosDomain, topic_keys
from pipeline.cli.sessions import NAMESPACE, Await, Namespace, StreamKey, Wait, ZenohConfig, session_config
from pipeline.cli.viewers import ViewOptions
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.exploration.source import Source

_ROBOT, _WAIT_S, _RATES = "asimo", 10.0, "rates"


@dataclass(frozen=True)
class DriveOptions:
    """Session with a robot that runs already."""

    connect: Annotated[
        list[str] | None,
        typer.Option(help="Drive the robot that runs there, in place of one of our own.", metavar="ENDPOINT"),
    ] = None
    awaited: Await = None
    epochs: Annotated[int, typer.Option(help="With --connect: epochs of the live session.", min=1, metavar="N")] = 1
    wait: Wait = _WAIT_S
    zenoh_config: ZenohConfig = None
    namespace: Namespace = NAMESPACE
    ros: RosDomain = None
    remap: Remap = None
    humble: Humble = False
    key: StreamKey = None

    @property
    def wanted(self) -> bool:
        """True if a running robot is driven."""
        in_ros = self.ros is not None and not of_settings("ros")
        return in_ros or bool(self.connect or self.zenoh_config)

    @property
    def has_more(self) -> bool:
        """True if anything is set that needs a running robot."""
        given = bool(self.awaited or self.key or self.remap or self.humble)
        return given or (self.epochs, self.wait, self.namespace) != (1, _WAIT_S, NAMESPACE)


@dataclass(frozen=True)
class SourceOptions:
    """Motion that the robot is to follow, and how."""

    motion: Annotated[
        str | None,
        typer.Option(
            help=f"One of {MOTIONS}, a CSV file with t,lx,ly,lz,rx,ry,rz [s, m], or volume: random points in the "
            "hands' boxes.",
            metavar="MOTION",
            autocompletion=complete_motion,
        ),
    ] = None
    no_teacher: Annotated[
        bool,
        typer.Option("--no-teacher", help="A learner leads the robot through volume, with what it has learned so far."),
    ] = False
    until: Annotated[
        float | None,
        typer.Option(help="With --no-teacher: end once it expects an error below this [cm].", metavar="CM"),
    ] = None
    duration: Annotated[
        float | None, typer.Option(help="With volume: how long [s], at most; 120 unless given.", metavar="SECONDS")
    ] = None
    tick_rate: Annotated[
        int | None,
        typer.Option(
            help="With volume: ticks in a second, 5 to 50; 5 unless given, 25 with --no-teacher.", metavar="HZ"
        ),
    ] = None
    teacher: Annotated[
        str,
        typer.Option(
            help="Teacher: rates (resolved rates, after Gienger), or qp (Drake's differential inverse kinematics with "
            "limits and distances).",
            metavar="rates|qp",
        ),
    ] = _RATES
    comfort_gain: Annotated[
        float | None,
        typer.Option(
            help="The teacher's approach to the comfort posture [1/s]: 20 with volume, 5 else, unless given.",
            metavar="GAIN",
        ),
    ] = None

    def source(self) -> "Source":
        """Return the source of the exploration; raises ConfigError if the options do not fit together."""
        from pipeline.exploration.source import self_exploration, source

        if self.no_teacher:
            if self.motion not in (None, "volume") or self.comfort_gain is not None or self.teacher != _RATES:
                raise ConfigError("--no-teacher: it follows volume, without a teacher or a gain; leave these away")
            return self_exploration(duration_s=self.duration, tick_rate_hz=self.tick_rate, until_cm=self.until)
        if self.motion is None or self.until is not None:
            raise ConfigError("expected --motion MOTION, or --no-teacher, which --until goes with")
        return source(
            self.motion,
            duration_s=self.duration,
            tick_rate_hz=self.tick_rate,
            comfort_gain=self.comfort_gain,
            teacher=self.teacher,
        )


@grouped
def explore(
    *,
    wanted: SourceOptions,
    out: Annotated[
        Path | None, typer.Option(help="Log to write, unless a running robot is driven.", metavar="LOG.mcap")
    ] = None,
    robot: Robot = _ROBOT,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    drive: DriveOptions,
    viewer: ViewOptions,
    as_json: Json = False,
) -> None:
    """Let the teacher, or a learner, lead a robot through a motion.

    A simulated robot makes a log; one that runs already is driven live.
    """
    if drive.wanted:
        if viewer.wanted:
            raise ConfigError("--view: a robot that runs is shown by `reenact learn --view`; leave --view away")
        if out is not None:
            raise ConfigError("--out: a live session is recorded with `reenact record`; leave --out away")
        if robot != _ROBOT or overwrite:
            raise ConfigError("--robot and --overwrite: expected --out beside them, and no robot that runs already")
        result = _drive(wanted.source(), seed, drive)
    else:
        if out is None:
            raise ConfigError("expected --out LOG.mcap, or --connect ENDPOINT to drive a running robot, found neither")
        if drive.has_more:
            needs = "--await, --epochs, --wait, --namespace, --remap, --humble and --key"
            raise ConfigError(f"{needs}: expected --connect or --ros beside them")
        result = _simulate(wanted.source(), robot, seed, out, viewer, overwrite=overwrite)
    console.show(result, as_json=as_json)


def _simulate(
    source: "Source", robot: str, seed: int, out: Path, viewer: ViewOptions, *, overwrite: bool
) -> dict[str, Any]:
    from pipeline.exploration.explore import explore as run
    from pipeline.exploration.self_explorer import learned
    from pipeline.robot.config import load_robot
    from recorders.writing.part_file import check_place

    check_place(out, overwrite=overwrite)
    config = load_robot(robot)
    title = f"explore {Path(source.name).stem}"
    motion, guidance = source.motion(config, seed=seed), source.guidance(config, seed=seed)
    with (
        note_partial_log(out),
        console.progress(title) as advance,
        viewer.robot(config, title=title) as on_message,
    ):
        summary = run(
            config,
            motion,
            seed=seed,
            out=out,
            guidance=guidance,
            config=source.config,
            overwrite=overwrite,
            progress=advance,
            on_message=on_message,
        )
    return asdict(summary) | {"path": str(summary.path)} | learned(guidance.guide)


def _drive(source: "Source", seed: int, drive: DriveOptions) -> dict[str, Any]:
    from pipeline.exploration.live import explore_live
    from replay.transports.sender_config import SenderConfig

    sender = SenderConfig(
        consumers=tuple(drive.awaited or ()),
        keys=topic_keys("explorer", drive.namespace, drive.ros, drive.remap, humble=drive.humble),
        batch_size=1,
        wait_s=drive.wait,
        key_file=drive.key,
    )
    with console.progress(f"explore {Path(source.name).stem}") as advance:
        live = explore_live(
            source,
            seed=seed,
            schedule=source.schedule(epochs=drive.epochs),
            session=session_config(None, drive.connect, drive.zenoh_config, listens=False, wait_s=drive.wait),
            sender=sender,
            progress=advance,
        )
    fields = asdict(live)
    learned: dict[str, Any] = fields.pop("learned")
    return fields | learned
