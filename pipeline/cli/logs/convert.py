"""The verb convert."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Overwrite, Pairs, Rule
from pipeline.cli.project_settings import of_settings
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from recorders.containers.reader import Opened
    from recorders.conversion.config import ConvertConfig


@dataclass(frozen=True)
class Chosen:
    """Topics and times that are taken of the recordings."""

    topic: Annotated[
        list[str] | None,
        typer.Option(help="Pattern of topics to keep, such as '/hand/*'; all if left out.", metavar="PATTERN"),
    ] = None
    start: Annotated[str | None, typer.Option(help="Start so long after the first message.", metavar="SECONDS")] = None
    end: Annotated[str | None, typer.Option(help="End so long after the first message.", metavar="SECONDS")] = None
    sort: Annotated[
        bool, typer.Option("--sort", help="Put a log of reenact in order of log time too, where its times fall.")
    ] = False


@dataclass(frozen=True)
class Written:
    """How it is written."""

    compression: Annotated[str, typer.Option(help="Compression of the chunks: lz4, zstd or none.", metavar="NAME")] = (
        "lz4"
    )
    split: Annotated[
        str | None,
        typer.Option(help="Begin another file after a size or a time, such as 100MB or 10min.", metavar="SIZE|TIME"),
    ] = None


@grouped
def convert(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recordings: MCAP, folders of rosbag2 or LeRobot, .db3, ROS 1 bags.", metavar="RECORDING"),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Log to write.", metavar="LOG.mcap")],
    chosen: Chosen,
    written: Written,
    alignment: AlignmentOptions,
    robot: Annotated[
        str | None,
        typer.Option(help="With ticks: the robot, of a recording that carries none.", metavar="ROBOT"),
    ] = None,
    rule: Rule = None,
    pairs: Pairs = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write recordings of any kind to MCAP.

    They are merged by log time, sliced, chosen by topic, renamed and split as asked for. Messages keep their bytes and
    encodings; the same recordings give the same file, to the byte. The manifest names each file with its SHA-256.

    With --tick-rate, --ticks-of or another option of alignment the result holds the ticks that `train` would learn
    from, for --rule and --pairs, and between them the phase markers of a session, by which `train --as-recorded` goes.
    """
    from recorders.conversion.convert import convert as run
    from recorders.reading.parts import recordings as find_recordings

    found: Sequence[Opened] = find_recordings(recordings)
    alignment = alignment.of_logs(found)
    config = _config(chosen, written, alignment)
    asked = {"robot": robot, "rule": rule, "pairs": pairs}
    if alignment.config().asks:
        found, config = _ticks(found, alignment, robot, rule, pairs), replace(config, renames={})
    elif any(value is not None and not of_settings(name) for name, value in asked.items()):
        raise ConfigError("--robot, --rule and --pairs: expected --tick-rate or --ticks-of beside them")
    with console.progress("convert") as advance:
        result = run(found, out, config, overwrite=overwrite, on_progress=advance)
    if as_json:
        console.show(result.to_dict(), as_json=True)
        return
    counts = {topic: str(count) for topic, count in result.counts.items()}
    console.entries(
        {
            "written": ", ".join(map(str, result.paths)),
            "from": ", ".join(source["name"] for source in result.sources),
            "messages": str(result.counts.total()),
            **counts,
        }
    )


def _ticks(
    found: "Sequence[Opened]", alignment: AlignmentOptions, robot: str | None, rule: str | None, pairs: str | None
) -> "Sequence[Opened]":
    """Return the ticks of a recording, as the learner of the rule takes them."""
    from pipeline.alignment.aligned_log import AlignedLog
    from pipeline.alignment.aligned_session import AlignedSession
    from pipeline.learner.registry import default_config
    from pipeline.robot.config import load_robot
    from pipeline.robot.recorded import recorded_hands
    from pipeline.training.pairing_choice import pairing_of

    if len(found) > 1:
        raise ConfigError(f"ticks: expected one recording, found {len(found)}; convert them one by one")
    config = None if robot is None else load_robot(robot)
    hands = recorded_hands(found[0], robot=config, renames=alignment.renames)
    tick = pairing_of(default_config(rule), pairs).topics(hands)
    ticks = alignment.align(found, robot=config, tick=tick)[0]
    return [AlignedSession(log) if isinstance(log, AlignedLog) and log.phases else log for log in ticks]


def _config(chosen: Chosen, written: Written, alignment: AlignmentOptions) -> "ConvertConfig":
    from recorders.conversion.config import ConvertConfig
    from recorders.text.quantities import parse_seconds, parse_size_or_time

    split_bytes, split_ns = (None, None) if written.split is None else parse_size_or_time(written.split, "--split")
    return ConvertConfig(
        topics=frozenset(chosen.topic or ()),
        renames=alignment.renames,
        start_ns=0 if chosen.start is None else parse_seconds(chosen.start, "--start"),
        end_ns=None if chosen.end is None else parse_seconds(chosen.end, "--end"),
        sort=chosen.sort,
        compression=written.compression,
        split_bytes=split_bytes,
        split_ns=split_ns,
    )
