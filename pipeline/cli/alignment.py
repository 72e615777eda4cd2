"""Options of alignment, the same for every verb that learns from logs, checks them, or serves."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.options import Renames, renames
from pipeline.cli.project_settings import of_settings
from pipeline.terminal import console
from recorders.errors import ConfigError
from recorders.text.wording import names_text

if TYPE_CHECKING:
    from pipeline.alignment.config import AlignmentConfig
    from pipeline.robot.config import RobotConfig
    from recorders.containers.reader import Opened


_BY_TOPIC = ("map_", "latency", "frame", "offset")
"""Options that name topics."""


@dataclass(frozen=True)
class AlignmentOptions:
    """Ticks of topics that have rates and stamps of their own, and names of topics."""

    map_: Renames = None
    tick_rate: Annotated[
        str | None,
        typer.Option(help="Align topics to ticks at this rate, where a log carries no ticks: 10.", metavar="HZ"),
    ] = None
    ticks_of: Annotated[
        str | None,
        typer.Option(help="Align topics to ticks at the stamps of this one.", metavar="TOPIC"),
    ] = None
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Make a tick where each topic has a message so near before and after it: 0.1.", metavar="SECONDS"
        ),
    ] = None
    latency: Annotated[
        list[str] | None,
        typer.Option(help="Stamps of a topic are so much later than what they are of.", metavar="TOPIC=SECONDS"),
    ] = None
    clock: Annotated[
        str | None,
        typer.Option(help="Align by header, the stamps of messages, or by log, where they have none.", metavar="CLOCK"),
    ] = None
    frame: Annotated[
        list[str] | None,
        typer.Option(
            help="Pose, in the robot's world, of the frame that a topic's poses are in: of the tracker's base.",
            metavar="TOPIC=x,y,z,qx,qy,qz,qw",
        ),
    ] = None
    offset: Annotated[
        list[str] | None,
        typer.Option(
            help="Pose of the hand in the frame of what a topic's poses are of: as seen from the marker on it.",
            metavar="TOPIC=x,y,z,qx,qy,qz,qw",
        ),
    ] = None

    @property
    def renames(self) -> dict[str, str]:
        """Our topic names for those of the logs; raises ConfigError if one is not FOREIGN=OURS."""
        return renames(self.map_)

    def of_logs(self, logs: "Sequence[Opened]") -> "AlignmentOptions":
        """Return the same options for some logs: what a project's settings say of topics that these lack is left out.

        A line is printed if settings have new names and the logs none of the topics.

        Raises
        ------
        LogError
            If a log cannot be read.
        """
        from recorders.containers.opening import open_log

        of_file = {
            field: pairs
            for field in _BY_TOPIC
            if of_settings(field.removesuffix("_")) and (pairs := getattr(self, field))
        }
        if not (of_file and logs):
            return self
        there = {topic for log in logs for topic in open_log(log).topics}
        kept: dict[str, Any] = {
            field: [pair for pair in pairs if pair.partition("=")[0] in there] for field, pairs in of_file.items()
        }
        if kept.get("map_") == []:
            named = names_text(pair.partition("=")[0] for pair in of_file["map_"])
            console.notice(f"no log has a topic of the settings' map, {named}: nothing is renamed")
        return replace(self, **kept)

    def among(self, topics: Collection[str]) -> "AlignmentOptions":
        """Return the same options with new names for these topics alone."""
        named = [f"{name}={ours}" for name, ours in self.renames.items() if name in topics]
        return replace(self, map_=named)

    def config(self) -> "AlignmentConfig":
        """Return the settings; raises ConfigError if one cannot be read or two exclude each other."""
        from pipeline.alignment.config import (
            AlignmentConfig,
            parse_latencies,
            parse_rate,
            parse_tolerance,
            parse_transforms,
        )

        return AlignmentConfig(
            period_ns=None if self.tick_rate is None else parse_rate(self.tick_rate),
            ticks_of=self.ticks_of,
            tolerance_ns=None if self.tolerance is None else parse_tolerance(self.tolerance),
            latencies_ns=parse_latencies(self.latency or ()),
            clock=self.clock,
            frames=parse_transforms(self.frame or (), "--frame"),
            offsets=parse_transforms(self.offset or (), "--offset"),
        )

    def live_config(self) -> "AlignmentConfig | None":
        """Return the settings for messages as they come, None if they are to be taken as they are."""
        config = self.config()
        return config if config.asks else None

    def refuse(self, beside: str, *, renames: bool = False) -> None:
        """Raise ConfigError if ticks, or new names, are asked for beside what takes messages as they are.

        Those of a project's settings are for other commands.
        """
        if renames and self.map_ and not of_settings("map"):
            raise ConfigError(f"{beside}: expected no --map beside it")
        of_file = {field.name: None for field in fields(self) if of_settings(field.name.rstrip("_").replace("_", "-"))}
        if replace(self, **of_file).config().asks:
            raise ConfigError(
                f"{beside}: expected none of --tick-rate, --ticks-of, --tolerance, --latency, --clock, --frame and "
                "--offset beside it"
            )

    def align(
        self, logs: "Sequence[Opened]", *, robot: "RobotConfig | None", tick: Sequence[str]
    ) -> "tuple[list[Opened], Mapping[str, str]]":
        """Return logs of ticks and the renames that are left to make, and print how they were aligned, if they were.

        Raises
        ------
        ReenactError
            As `pipeline.alignment.align.align_logs` does.
        """
        from pipeline.alignment.align import align_logs
        from pipeline.alignment.aligned_log import AlignedLog

        aligned, left = align_logs(logs, self.config(), robot=robot, renames=self.renames, tick=tick)
        for log in aligned:
            if isinstance(log, AlignedLog):
                for line in log.summary.lines(log.path.name):
                    console.notice(line)
        return aligned, left
