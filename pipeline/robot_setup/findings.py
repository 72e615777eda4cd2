"""Findings about a robot folder: what in it would go wrong in use, one line each."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import TOML_FILE, RobotConfig, load_robot, robot_names
from pipeline.robot.coordinates import POSITION_SIZE, centre_rows, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_setup.box import BoxSearch, reach_bound_m
from pipeline.robot_setup.moved_hands import idle_joints_text
from pipeline.robot_setup.statics import Statics
from pipeline.teacher.teacher import Teacher, approach, misses_m
from recorders.errors import RobotError
from recorders.text.wording import hand_text, names_text

_LIMIT_MARGIN = 0.02  # of a joint's range: nearer to a limit no joint is at rest
_BOXES = (0.75, 0.5, 0.25, 0.1)  # of a box that is too large: the first of these that fits is what to take


def findings(robot: RobotConfig) -> Iterator[str]:
    """Yield what is wrong with a robot, a line each: its comfort posture, motors, centres and boxes."""
    yield from _comfort(robot)
    yield from _loads(robot)
    unreached = list(_centres(robot))
    yield from unreached
    if not unreached:
        yield from _boxes(robot)


def _comfort(robot: RobotConfig) -> Iterator[str]:
    margins = np.minimum(robot.comfort - robot.lower, robot.upper - robot.comfort) / (robot.upper - robot.lower)
    for name, value, margin in zip(robot.joints, robot.comfort, margins, strict=True):
        if margin < _LIMIT_MARGIN:
            yield (
                f"joint {name}: expected its comfort at least {100 * _LIMIT_MARGIN:g} % of its range from both limits, "
                f"found {value:g}, {100 * margin:.1f} % from one"
            )


def _loads(robot: RobotConfig) -> Iterator[str]:
    statics = Statics(robot)
    for name, load, effort in zip(robot.joints, statics.loads(robot.comfort), statics.efforts, strict=True):
        if load >= 1.0:
            yield (
                f"joint {name}: expected a motor that holds the comfort posture, which takes {load * effort:.3g}, "
                f"found an effort limit of {effort:.3g}"
            )


def _centres(robot: RobotConfig) -> Iterator[str]:
    kinematics, centres, bound_m = Kinematics(robot), centre_rows(robot), reach_bound_m(robot)
    _, short_m = approach(Teacher(kinematics), robot.comfort, centres, bound_m)
    at_rest = to_rows(robot, kinematics.inputs(robot.comfort))
    least_m = np.minimum(short_m, misses_m(robot, at_rest, centres))  # what is far may draw the arm away
    for hand, short, least, centre, rest in zip(robot.hands, short_m, least_m, centres, at_rest, strict=True):
        if short > bound_m:
            yield (
                f"{hand_text(hand.name)}: expected its centre within reach, found it at {_place_text(centre)}, to "
                f"which the hand came no nearer than {100 * least:.1f} cm; in the comfort posture it is at "
                f"{_place_text(rest)}"
            )


def _place_text(row: Floats) -> str:
    return f"({', '.join(f'{value:.2f}' for value in row[:POSITION_SIZE])}) m"


def _boxes(robot: RobotConfig) -> Iterator[str]:
    search = BoxSearch(robot, reach_only=True)
    if (obstacle := search.obstacle(robot.boxes)) is None:
        return
    fits = next((part for part in _BOXES if search.obstacle(part * robot.boxes) is None), None)
    advice = (
        "move the centres, or make them much smaller" if fits is None else f"{100 * fits:g} % of their size would do"
    )
    yield f"boxes of the hands: expected every corner within reach, found that {obstacle}; {advice}"


def check_robot(name_or_folder: str) -> tuple[list[str], str | None]:
    """Return what is wrong with a robot that comes with the program, or with a folder, and what is not but of note.

    The list is empty if nothing is wrong.

    Raises
    ------
    RobotError
        There is no such robot, or the folder holds none.
    """
    folder = Path(name_or_folder)
    names = robot_names()
    if name_or_folder not in names and not (folder / TOML_FILE).is_file():
        raise RobotError(f"{folder}: expected a robot's folder, with {TOML_FILE} in it, or one of {names_text(names)}")
    try:
        robot = load_robot(name_or_folder)
        return list(findings(robot)), idle_joints_text(robot)
    except RobotError as error:
        return [str(error)], None
