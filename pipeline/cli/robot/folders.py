"""The verbs robot new and robot check."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Seed
from pipeline.terminal import console
from recorders.errors import CheckFailed

if TYPE_CHECKING:
    from pipeline.robot_setup.new_robot import NewRobot, RobotRequest

PICTURE_FILE = "reach.png"


@dataclass(frozen=True)
class ModelOptions:
    """What the URDF does not say, and what of it is not wanted."""

    package: Annotated[
        str | None,
        typer.Option(help="Installed package that has the URDF, which is then named and not copied.", metavar="NAME"),
    ] = None
    name: Annotated[
        str | None, typer.Option(help="Name of the robot; that of the folder if left out.", metavar="NAME")
    ] = None
    limit: Annotated[
        list[str] | None,
        typer.Option(
            help="Limits of a joint [rad or m] in place of the URDF's, and its velocity and effort behind them; '*' "
            "stands for any letters. May be repeated.",
            metavar="JOINT=LOWER,UPPER",
        ),
    ] = None
    fix: Annotated[
        list[str] | None,
        typer.Option(help="A joint that is to be rigid, at 0 or POSITION. May be repeated.", metavar="JOINT=POSITION"),
    ] = None
    drop: Annotated[
        list[str] | None,
        typer.Option(help="A joint to leave out with all that hangs on it. May be repeated.", metavar="JOINT"),
    ] = None
    pose: Annotated[
        bool, typer.Option("--pose", help="Control how the hands are turned, too, not only where they are.")
    ] = False
    height: Annotated[float, typer.Option(help="Height of the URDF's root above the ground [m].", metavar="METRES")] = (
        0.0
    )

    def request(self, urdf: str, hands: list[str], out: Path, seed: int) -> "RobotRequest":
        """Return what is known of the robot; raises RobotError if an option cannot be read."""
        from pipeline.robot_setup.new_robot import RobotRequest
        from pipeline.robot_setup.request_texts import parse_hands, parse_limits, parse_rigid, robot_name

        return RobotRequest(
            urdf=urdf,
            hands=parse_hands(hands),
            name=self.name or robot_name(out.resolve().name),
            package=self.package,
            limits=parse_limits(self.limit or []),
            rigid=parse_rigid(self.fix or []),
            drop=tuple(self.drop or ()),
            height_m=self.height,
            pose=self.pose,
            seed=seed,
        )


@grouped
def new(
    urdf: Annotated[str, typer.Argument(help="The robot's URDF.", metavar="ROBOT.urdf")],
    *,
    hand: Annotated[
        list[str],
        typer.Option(help="Link of a hand, with a name for it as NAME=LINK. May be repeated.", metavar="LINK"),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write.", metavar="DIR")],
    model: ModelOptions,
    seed: Seed = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the files of a robot in the folder.")] = False,
    as_json: Json = False,
) -> None:
    """Write the folder of a robot that has a URDF.

    Joints, limits, comfort posture, centres and boxes are found and shown, with a picture of the reach.
    """
    from pipeline.robot_setup.findings import findings
    from pipeline.robot_setup.moved_hands import idle_joints_text
    from pipeline.robot_setup.new_robot import check_folder, make_robot
    from pipeline.robot_setup.summary import summary

    check_folder(out, overwrite=overwrite)
    made = make_robot(model.request(urdf, hand, out, seed))
    written = made.write(out, overwrite=overwrite)
    shown = summary(made) | {"path": str(out), "picture": _draw(made, out), "findings": list(findings(written))}
    if as_json:
        console.show(shown, as_json=True)
    else:
        _show(shown)
    _note(idle_joints_text(written))


def check(
    folder: Annotated[str, typer.Argument(help="A robot's folder, or one that comes with the program.", metavar="DIR")],
    as_json: Json = False,
) -> None:
    """Check a robot's folder: a line for each thing that is wrong.

    Its files, its comfort posture, motors, centres and boxes. Exit status 1 if anything is.
    """
    from pipeline.robot_setup.findings import check_robot

    found, note = check_robot(folder)
    if as_json:
        console.show({"robot": folder, "findings": found}, as_json=True)
    else:
        for line in found or [f"{folder}: nothing wrong found"]:
            console.line(line)
    _note(note)
    if found:
        raise typer.Exit(CheckFailed.exit_status)


def _note(line: str | None) -> None:
    if line is not None:
        console.notice(line)


def _draw(made: "NewRobot", out: Path) -> str | None:
    """Draw the reach beside the robot's files; None, and a line, where nothing can draw."""
    from pipeline.extras import missing_extra

    try:
        from pipeline.views.reach import draw_reach
    except ModuleNotFoundError as error:
        if (missing := missing_extra(error)) is None:
            raise
        console.notice(f"no picture of the reach: {missing}")
        return None
    draw_reach(made.config, made.reach, out / PICTURE_FILE)
    return str(out / PICTURE_FILE)


def _show(shown: dict[str, Any]) -> None:
    from pipeline.terminal.robot_tables import robot_table

    console.table(robot_table(shown["joints"], ("joint", "type", "lower", "upper", "limits", "comfort", "hands")))
    console.table(robot_table(shown["hands"], ("hand", "link", "controls", "centre", "box", "reach", "freedom")))
    rest = {name: value for name, value in shown.items() if name not in ("joints", "hands", "findings")}
    console.show(rest, as_json=False)
    for line in shown["findings"]:
        console.notice(line)
