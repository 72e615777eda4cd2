"""The verb export."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import Json
from pipeline.cli.project_settings import of_settings
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.samples.frames import FrameReader
    from recorders.reading.parts import Log

_LEROBOT = "lerobot"


@grouped
def export(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings of any kind.", metavar="RECORDING")],
    *,
    out: Annotated[Path, typer.Option(help="Folder to make.", metavar="FOLDER")],
    form: Annotated[str, typer.Option("--format", help="csv, parquet or lerobot.", metavar="FORMAT")] = "csv",
    topic: Annotated[
        list[str] | None,
        typer.Option(help="Pattern of topics to write, such as '/hand/*'; all if left out.", metavar="PATTERN"),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="With lerobot: the robot, of recordings that carry none.", metavar="ROBOT"),
    ] = None,
    action: Annotated[
        str | None,
        typer.Option(
            help="With lerobot: actions are the commands to joints, targets of hands, or none; the first there is.",
            metavar="ACTION",
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="With lerobot: what is done, in words; the name of the recording.", metavar="TEXT"),
    ] = None,
    alignment: AlignmentOptions,
    as_json: Json = False,
) -> None:
    """Write recordings as tables or as a LeRobotDataset.

    Tables are a file for each topic. In a table a message is a row, with a column for each number or text in it; joints
    have columns by their names. Topics that cannot be decoded are named and left out.

    A LeRobotDataset has a frame for each tick, of joints, hands and actions; the ticks are those of the recording, or
    made by the options of alignment, and must be at one rate of whole Hz. An action is what was asked of the robot
    when the frame was taken: the last command to its joints, where the recordings have /joint_commands.
    """
    if form == _LEROBOT:
        if topic:
            raise ConfigError("--topic: expected --format csv or parquet beside it, found lerobot")
        _export_dataset(recordings, out, alignment, robot=robot, action=action, task=task, as_json=as_json)
        return
    asked = {"robot": robot, "action": action, "task": task}
    if any(value is not None and not of_settings(name) for name, value in asked.items()):
        raise ConfigError("--robot, --action and --task: expected --format lerobot beside them")
    alignment.refuse(f"--format {form}", renames=True)
    _export_tables(recordings, out, form, topic or [], as_json=as_json)


def _export_tables(paths: list[Path], out: Path, form: str, topics: list[str], *, as_json: bool) -> None:
    from recorders.export.export import export as run
    from recorders.reading.parts import one_session

    result = run(one_session(paths), out, form=form, topics=topics)
    for name, why in result.unreadable.items():
        console.notice(f"left out: {name}: {why}")
    if as_json:
        console.show(result.to_dict(), as_json=True)
    else:
        console.entries({name: f"{_rows(result.rows[name])} in {path}" for name, path in result.files.items()})


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def _export_dataset(
    paths: list[Path],
    out: Path,
    alignment: AlignmentOptions,
    *,
    robot: str | None,
    action: str | None,
    task: str | None,
    as_json: bool,
) -> None:
    from recorders.export.lerobot.dataset import Dataset, write_dataset
    from recorders.reading.parts import recordings as find_recordings

    if out.exists():
        raise ConfigError(f"{out} exists: choose another name for the folder")
    found = find_recordings(paths)
    name, frames, action = _frames(found, alignment, robot, action)
    text = task or ", ".join(log.stem for log in found)
    dataset = Dataset(frames.rate(), name, text, frames.features, frames.episodes)
    write_dataset(dataset, out)
    if frames.dropped:
        console.notice(f"left out: {frames.dropped} frames before the first command")
    if action == "none":
        console.notice("no action: the recordings have neither commands to joints nor targets of hands")
    shape = {"episodes": len(dataset.episodes), "frames": sum(dataset.lengths), "fps": dataset.fps}
    if as_json:
        features = {name: list(names) for name, names in frames.features.items()}
        console.show({"out": str(out), **shape, "action": action, "features": features}, as_json=True)
        return
    columns = {column: ", ".join(names) for column, names in frames.features.items()}
    console.entries({"written": str(out), **{key: str(value) for key, value in shape.items()}, **columns})


def _frames(
    found: "Sequence[Log]", alignment: AlignmentOptions, robot: str | None, action: str | None
) -> "tuple[str, FrameReader, str]":
    """Return the name of the robot, the frames of recordings, and what their actions are."""
    from pipeline.robot.config import load_robot
    from pipeline.robot.recorded import require_recorded_robot
    from pipeline.samples.frames import Commands, FrameReader, choose_action, frame_topics
    from recorders.containers.opening import open_log

    alignment = alignment.of_logs(found)
    readers, renames, config = [open_log(log) for log in found], alignment.renames, alignment.config()
    known = load_robot(robot) if robot else require_recorded_robot(readers[0], has_option=True)
    topics = frame_topics(readers, known, renames)
    chosen = choose_action(action, readers, topics, renames)
    ticks, left = alignment.align(found, robot=known, tick=topics)
    frames = FrameReader(known, topics, chosen)
    for reader, log in zip(readers, ticks, strict=True):
        commands = None
        if chosen == "commands":
            commands = Commands.of(
                reader, known, renames, latencies_ns=config.latencies_ns, by_log_time=config.by_log_time
            )
        frames.read(open_log(log), left, commands)
    return known.name, frames, chosen
