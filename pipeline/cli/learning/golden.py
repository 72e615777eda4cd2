"""The verbs golden add and golden check."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Pairs, Rule, StreamsRobot
from pipeline.cli.usage import Verbs, help_without_verb
from pipeline.resources import data_path
from pipeline.terminal import console
from recorders.errors import CheckFailed, ConfigError

if TYPE_CHECKING:
    from pipeline.samples.pairing import PairingRule
    from recorders.containers.reader import Opened

app = Verbs(
    name="golden",
    help="Golden-log regression: make cases, check them.",
    epilog="Example: reenact golden check golden",
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _golden(ctx: typer.Context) -> None:
    help_without_verb(ctx)


@dataclass(frozen=True)
class CaseOptions:
    """Learning and checks of a case; None keeps what an existing case has."""

    rule: Rule = None
    pairs: Pairs = None
    epochs: Annotated[int | None, typer.Option(help="Epochs, at most 6; 2, or as recorded.", min=1, metavar="N")] = None
    as_recorded: Annotated[
        bool | None,
        typer.Option("--as-recorded/--not-as-recorded", help="Follow the phase markers of a recorded session."),
    ] = None
    resume_after: Annotated[
        int | None, typer.Option(help="Stop after so many ticks, and go on from a checkpoint.", min=1, metavar="N")
    ] = None
    physics: Annotated[
        bool | None, typer.Option("--physics/--no-physics", help="Check teacher and simulation, too.")
    ] = None


@app.command(
    epilog="Example: reenact golden add eight.mcap --config learner.toml --name eight --cases golden --physics"
)
@grouped
def add(
    *,
    name: Annotated[str, typer.Option(help="Name of the case.", metavar="NAME")],
    logs: Annotated[
        list[Path] | None, typer.Argument(help="Logs, presented in this order.", metavar="LOG.mcap")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Settings of the learner, seed included (TOML).", metavar="FILE")
    ] = None,
    cases: Annotated[Path, typer.Option(help="Folder of the cases.", metavar="DIR")] = Path("golden"),
    case: CaseOptions,
    robot: StreamsRobot = None,
    alignment: AlignmentOptions,
    reason: Annotated[
        str | None, typer.Option(help="Why an existing case changes; stored in its history.", metavar="TEXT")
    ] = None,
    as_json: Json = False,
) -> None:
    """Make a golden case of logs and a learner, or accept a change.

    An existing case keeps whatever is not given anew: its logs, settings, epochs, tolerances and what is checked. Of
    logs that are aligned it has the ticks, each episode as a log of its own.
    """
    from pipeline.golden.runner import GoldenRunner, asked_pairing, check_new_case, recipe
    from replay.golden.add import add_case
    from replay.golden.case import check_name, load_case
    from replay.golden.folder import roll_back

    folder = cases / check_name(name)
    for path in (cases, folder):
        if path.exists() and not path.is_dir():
            raise ConfigError(f"{path}: expected a folder, found a file, which stays as it is; choose another name")
    roll_back(folder)
    old = load_case(folder).recipe if folder.exists() else None
    if old is None:
        check_new_case(logs or [], config, rule=case.rule)
    with TemporaryDirectory() as temporary, console.progress("golden add") as advance:
        pairs = asked_pairing(config, old, rule=case.rule, pairs=case.pairs)
        found = _found(logs or [], robot, alignment, pairs, session=bool(case.as_recorded))
        files = _as_files(found, Path(temporary), session=bool(case.as_recorded))
        case_spec = recipe(files, config, old=old, **asdict(case))
        added = add_case(folder, case_spec, GoldenRunner(), reason=reason, progress=advance)
    size = sum(path.stat().st_size for path in added.folder.iterdir())
    shown = {"case": str(added.folder), "bytes": size, "digest": added.expected["digest"]}
    console.show({**shown, "errors_cm": added.expected["errors_cm"]}, as_json=as_json)


def _found(
    logs: list[Path], robot: str | None, alignment: AlignmentOptions, pairing: "PairingRule", *, session: bool
) -> "Sequence[Opened]":
    """Return the recordings, as ticks where they are aligned, with the robot that is given."""
    from pipeline.robot.config import load_robot
    from pipeline.robot.recorded import recorded_hands, with_robot
    from recorders.reading.parts import one_session, recordings

    config = None if robot is None else load_robot(robot)
    found = [one_session(logs)] if session and logs else recordings(logs)
    alignment = alignment.of_logs(found)
    if session or not found:
        alignment.refuse("--as-recorded" if session else "golden add without logs")
        return [with_robot(log, config) for log in found]
    hands = recorded_hands(found[0], robot=config, renames=alignment.renames)
    aligned, names = alignment.align(found, robot=config, tick=pairing.topics(hands))
    if names:
        raise ConfigError("--map: expected logs that are to be aligned, found ticks; a case has our names alone")
    return [with_robot(log, config) for log in aligned]


def _as_files(found: "Sequence[Opened]", folder: Path, *, session: bool) -> list[Path]:
    """Return the recordings as one log each, as a case needs them: parts are joined, and bags copied, in a folder."""
    from pipeline.alignment.aligned_log import AlignedLog, write_episodes
    from recorders.reading.parts import Parts
    from replay.golden.log_tier import strip_topics

    files: list[Path] = []
    for index, log in enumerate(found):
        if isinstance(log, AlignedLog):
            files += write_episodes(log, folder / str(index))
        elif isinstance(log, Path):
            files.append(log)
        else:
            copied = folder / str(index) / f"{(log if isinstance(log, Parts) else log.path).stem}.mcap"
            copied.parent.mkdir()
            strip_topics(log, copied, physics=True, file_order=session)
            files.append(copied)
    return files


@app.command(epilog="Example: reenact golden check golden --json")
def check(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of cases, or of one; by default those of the program.", metavar="DIR")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Settings of your learner (TOML), to be those of every case.", metavar="FILE")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Your robot, to be that of every case's logs: its folder.", metavar="DIR")
    ] = None,
    physics: Annotated[
        bool, typer.Option("--physics", help="Fail where the simulation of a case cannot be checked.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check golden cases against the present program.

    A case has copies of learner settings and robot, which it is checked with; with --config and --robot they must be
    what you use today. Exit status 1 if a case does not hold.
    """
    from pipeline.golden.own_settings import Own
    from pipeline.golden.runner import GoldenRunner
    from replay.golden.check import check_all, summary

    own = Own(config=config, robot=robot)
    with console.progress("golden check") as advance:
        cases = folder or data_path("golden")
        verdicts = list(check_all(cases, GoldenRunner(), changed=own.difference, progress=advance))
    if as_json:
        console.show(summary(verdicts), as_json=True)
    else:
        for verdict in verdicts:
            notes = verdict.finding or (verdict.physics and f"physics {verdict.physics}")
            console.line(f"{verdict.status}  {verdict.name}" + (f"  {notes}" if notes else ""))
    missing = next((verdict.not_checked for verdict in verdicts if verdict.not_checked), None)
    if physics and missing is not None:
        raise missing
    if any(verdict.finding for verdict in verdicts):
        raise typer.Exit(CheckFailed.exit_status)
